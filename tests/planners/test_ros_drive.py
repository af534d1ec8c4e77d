"""RosDrive and its transports, against a stand-in for rosbridge and the controller in another process."""

import json
import socket
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import optik
import planners
from benchmarks.cli.app import app
from optik.errors import InvalidInput, MissingDependency, NoSolution, OptikError
from planners.cell.drives._ros_run import make_message, make_stops
from planners.cell.drives.ros import RosDrive
from planners.cell.show import restore_plan
from planners.ros.rclpy import RclpyTransport
from planners.ros.rosbridge import Fragments, RosbridgeTransport
from tests.planners.invalid import invalid
from tests.planners.rclpy_stand_in import Rclpy
from tests.planners.rosbridge_server import commanded

SERVER = Path(__file__).with_name("rosbridge_server.py")
PATIENT = {"execute": True, "patience": 20.0, "grace": 60.0, "latency": 0.6, "stops_every": 0.7}
"""For what must succeed on a machine that is busy: nothing waits that long where it is not."""


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with subprocess.Popen([sys.executable, str(SERVER)], stdout=subprocess.PIPE, text=True) as server:
        yield int(server.stdout.readline())
        server.kill()


@pytest.fixture(scope="module")
def plan() -> planners.Plan:
    return hop(4.0)  # long enough for a stop that a busy machine computes late


@cache
def hop(seconds: float) -> planners.Plan:
    """A motion in joint space with few knots, of an arm without masses: its certificates take milliseconds."""
    robot = optik.load("irb120")
    limits = planners.MotionLimits(velocity=2.0, acceleration=10.0, jerk=200.0)
    q, options = robot.limits.middle, {"timing": "ruckig", "limits": limits}
    return planners.plan(robot, q + np.array([0.3, -0.2, 0.25, 0.1, 0.2, 0.1]), q, duration=seconds, **options)


@cache
def fast() -> planners.Plan:
    """A motion at the velocity limit."""
    robot = optik.load("irb120")
    limits = planners.MotionLimits(velocity=1.0, acceleration=10.0, jerk=200.0)
    q = robot.limits.middle + np.array([-1.0, -0.3, -0.3, -1.0, -0.5, -1.0])
    goal = robot.limits.middle + np.array([1.0, 0.3, 0.3, 1.0, 0.5, 1.0])
    return planners.plan(robot, goal, q, timing="ruckig", limits=limits)


def address(port: int, mode: str, plan: planners.Plan, more: str = "", at: Any = None) -> str:
    """Of a controller of its own."""
    q = ",".join(map(str, plan.trajectory(0.0) if at is None else at))
    return f"ws://127.0.0.1:{port}/{mode}?id={uuid.uuid4()}&names={','.join(plan.robot.joint_names)}&q={q}{more}"


def drive_on(url: str, plan: planners.Plan, **options: Any) -> RosDrive:
    return RosDrive(plan.robot, RosbridgeTransport(url, timeout=20.0), **options)


def test_a_dry_run_checks_everything_and_sends_nothing(port, plan):
    drive = drive_on(address(port, "ok", plan), plan, patience=20.0)
    with drive.transport:
        dry = drive.execute(plan)
        assert (dry.status, dry.motion) == ("dry_run", None)
        assert "points of 4.0004 s to ws://127.0.0.1" in dry.reason and dry.advice == "execute=True sends it"
        time.sleep(0.2)
        np.testing.assert_array_equal(drive.measure(), plan.trajectory(0.0))  # and the arm stands where it stood


def test_an_execution_follows_the_controller_by_the_robots_clock(port):
    seen, plan = [], hop(1.5)
    drive = drive_on(address(port, "ok", plan), plan, **PATIENT)
    with drive.transport:
        done = drive.execute(plan, watch=seen.append)
    assert done and done.status == "done" and done.fault is None, done.reason
    assert done.plan.certificate.is_valid and abs(done.motion.end - 1.5) < 1e-3
    np.testing.assert_allclose(done.q[-1], plan.trajectory(plan.trajectory.end), atol=1e-9)
    # What the joint states say is what was sent, at the instants of the robot's clock: its points reproduce the motion.
    assert len(done.t) > 20 and np.abs(done.q - done.setpoints.q).max() < 1e-5
    assert len(seen) > 20 and seen[-1].t <= time.monotonic()


@pytest.mark.parametrize(("more", "off"), [("", 1e-5), ("&legacy=1", 2e-2)])
def test_a_stop_replaces_the_goal_at_an_instant_of_the_controllers_clock_and_resume_goes_on(port, plan, more, off):
    drive = drive_on(address(port, "ok", plan, more), plan, **PATIENT)
    with drive.transport:
        stopped = drive.execute(plan, stop=0.2)
        assert stopped.status == "stopped" and stopped.stop_plan is not None, (stopped.reason, stopped.notes)
        assert stopped.stop_plan.certificate.is_valid and stopped.motion.end < 3.9
        # Older controllers go to the first point of the stop by a quintic of their own; newer ones go on along the plan.
        assert np.abs(stopped.q - stopped.setpoints.q).max() < off
        np.testing.assert_allclose(
            stopped.q[-1], stopped.stop_plan.trajectory(stopped.stop_plan.trajectory.end), atol=1e-6
        )
        assert np.abs(stopped.q[-1] - plan.trajectory(4.0)).max() > 0.01  # it did not go to the end
        rest = drive.resume(stopped)
        assert rest, (rest.reason, rest.notes)
        np.testing.assert_allclose(rest.q[-1], plan.trajectory(plan.trajectory.end), atol=1e-6)
        with pytest.raises(InvalidInput, match="stopped"):
            drive.resume(rest)
        again = drive.resume(stopped)  # the arm stands at the goal by now
        assert again.status == "refused" and "at the end of the path" in again.reason


@pytest.mark.parametrize("mode", ["blocking", "oddonce"])
def test_a_stop_reaches_an_old_rosbridge_that_reads_nothing_and_one_feedback_may_be_odd(port, plan, mode):
    drive = drive_on(address(port, mode, plan), plan, **PATIENT)
    with drive.transport:
        stopped = drive.execute(plan, stop=lambda t: t > 0.2)
    assert stopped.status == "stopped" and stopped.stop_plan is not None, (stopped.reason, stopped.notes)


@pytest.mark.parametrize(
    ("mode", "why"),
    [
        ("rejectstop", "stop: Action goal was rejected"),
        ("quietstop", "did not accept the stop"),
        ("oddfeedback", "no feedback"),
        ("elsewhere", "no feedback"),
    ],
)
def test_where_no_stop_is_taken_the_goal_is_cancelled(port, plan, mode, why):
    drive = drive_on(address(port, mode, plan), plan, **PATIENT)
    with drive.transport:
        stopped = drive.execute(plan, stop=0.2)
    assert (stopped.status, stopped.stop_plan) == ("stopped", None), (stopped.reason, stopped.notes)
    assert why in stopped.reason and any("controller's own" in note for note in stopped.notes)
    assert np.abs(stopped.q[-1] - plan.trajectory(4.0)).max() > 0.01


@pytest.mark.parametrize(
    ("mode", "kind", "why"),
    [
        ("reject", "controller", "goal: Action goal was rejected"),
        ("quiet", "connection", "within 1 s"),
        ("abort", "stall", "path tolerance"),
        ("broken", "controller", "code -9: hardware fault"),
        ("oddresult", "controller", "cannot be read"),
        ("falseresult", "controller", "no result: the executor was shut down"),
        ("frozen", "encoder", "its encoder is frozen, or it is blocked"),
        ("close", "connection", "closed by the other side while a goal ran"),
        ("noresult", "stall", "within 0.2 s after"),
        ("freeze", "encoder", "stale"),
    ],
)
def test_every_fault_is_a_status_with_a_reason(port, plan, mode, kind, why, capfd):
    short = hop(1.0)
    patience = 20.0 if mode in ("reject", "close") else 1.0
    options = {"execute": True, "patience": patience, "stops_every": 0.5, "grace": 0.2 if mode == "noresult" else 20.0}
    drive = drive_on(address(port, mode, short), short, **options)
    with drive.transport:
        done = drive.execute(short)
    assert (done.status, done.fault and done.fault.kind) == ("fault", kind), (done.reason, done.notes)
    assert why in done.reason and done.advice
    assert "Traceback" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("mode", ["falseresult", "frozen"])
def test_after_a_false_result_and_with_a_frozen_encoder_the_arm_comes_to_rest(port, mode, tmp_path):
    long, trace = hop(6.0), tmp_path / "trace.jsonl"
    drive = drive_on(address(port, mode, long, f"&trace={trace}"), long, execute=True, patience=20.0)
    with drive.transport:
        done = drive.execute(long)
    assert done.status == "fault", done.reason
    assert done.t[-1] < 4.0 and np.abs(done.q[-1] - long.trajectory(6.0)).max() > 0.01  # it did not go on to the end
    q = commanded(trace, 0.004)
    assert np.abs(q[-1] - q[-2]).max() == 0.0 and np.abs(q[-1] - long.trajectory(6.0)).max() > 0.01


@pytest.mark.parametrize("late", [0.2, 0.5])
def test_no_stop_is_sent_for_an_instant_that_is_over_when_feedback_is_late(port, plan, late, tmp_path):
    trace, quick = tmp_path / "trace.jsonl", fast()
    url = address(port, "ok", quick, f"&least={late}&late={late}&trace={trace}")
    drive = drive_on(url, quick, execute=True, patience=20.0)
    with drive.transport:
        stopped = drive.execute(quick, stop=0.7)
    assert stopped.status == "stopped", (stopped.reason, stopped.notes)
    q, most = commanded(trace, 0.004), np.asarray(quick.limits.velocity) * 0.004
    assert (np.abs(np.diff(q, axis=0)) <= most).all(), (stopped.reason, stopped.notes)
    if (
        stopped.stop_plan is not None
    ):  # the certified stop is what was commanded: it ends where that was computed to end
        np.testing.assert_allclose(q[-1], stopped.stop_plan.trajectory(stopped.stop_plan.trajectory.end), atol=1e-6)
        assert not any("set-point jumped" in note for note in stopped.notes)


def test_messages_in_parts_are_put_together(port):
    quick = hop(0.6)
    drive = drive_on(address(port, "ok", quick, "&fragment=90"), quick, **PATIENT)
    with drive.transport:
        assert drive.execute(quick), drive.transport.odd
    parts = Fragments()
    text = json.dumps({"op": "status", "msg": "words " * 20})
    cut = [text[:50], text[50:100], text[100:]]
    rows = [{"op": "fragment", "id": 7, "data": each, "num": i, "total": 3} for i, each in enumerate(cut)]
    assert [parts.joined(rows[i]) for i in (2, 0, 1)] == [None, None, text.encode()]
    nested = json.dumps(rows[0])
    for odd in ({"num": -1, "total": 3, "data": ""}, {"num": 0, "total": 10**9, "data": ""}, {"num": 0, "total": 1, "data": 7},
                {"num": 0, "total": 1, "data": nested}, {"num": "0", "total": 1, "data": ""}, {}):  # fmt: skip
        with pytest.raises(InvalidInput, match="fragment"):
            parts.joined(odd)


@pytest.mark.parametrize(
    ("mode", "why"),
    [
        ("silent", "no joint states"), ("nonsense", "within 0.3 s; the latest message that could not be read"),
        ("wrong", "position: expected 6 numbers; got '0.1, 0.2'"), ("stale", "stale"),
        ("nan", "the position of joint2"), ("null", "the position of joint2"), ("missing", "they have gripper"),
        ("novelocity", "no velocity of"),
    ],
)  # fmt: skip
def test_nothing_is_sent_to_an_arm_whose_joints_are_not_known(port, plan, mode, why, capfd):
    drive = drive_on(address(port, mode, plan), plan, execute=True, patience=0.3)
    with drive.transport:
        refused = drive.execute(plan)
        assert np.isnan(drive.measure()).any() or mode == "novelocity"
    assert refused.status == "refused" and why in refused.reason and refused.advice, refused.reason
    assert "Traceback" not in "".join(capfd.readouterr())


def test_nothing_is_sent_to_an_arm_that_stands_elsewhere(port, plan):
    elsewhere = plan.trajectory(0.0) + np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0])
    drive = drive_on(address(port, "ok", plan, at=elsewhere), plan, execute=True, patience=20.0)
    with drive.transport:
        refused = drive.execute(plan)
        assert refused.status == "refused" and f"{plan.robot.joint_names[2]} is at" in refused.reason, refused.reason
        near = RosDrive(plan.robot, drive.transport, patience=20.0, start_tolerance=0.03)
        assert near.execute(plan).status == "dry_run"


def test_nothing_is_sent_whose_certificate_does_not_hold_now(port, plan):
    drive = drive_on(address(port, "ok", plan), plan, execute=True, patience=20.0)
    slow = planners.MotionLimits(velocity=0.01, acceleration=1.0, jerk=10.0)
    stale = replace(plan, limits=slow)  # its stored certificate, of other limits, holds
    moving = planners.replan(plan, 1.0)
    with drive.transport:
        refused = drive.execute(stale)
        assert stale.certificate.is_valid and refused.status == "refused" and "velocity" in refused.reason, (
            refused.reason
        )
        assert "begins in motion" in drive.execute(moving).reason
        free = {"timing": "quintic", "allow": ("limits", "jerk")}  # a law that enforces nothing
        quintic = planners.plan(plan.robot, plan.path, limits=plan.limits, **free)
        assert quintic and "acceleration" in drive.execute(quintic).reason
        with pytest.raises(InvalidInput, match="this drive's arm"):
            drive.execute(replace(plan, robot=optik.load("ur5e")))


def test_what_the_caller_permits_is_sent(port):
    touching = invalid("contact", 1).plan
    drive = drive_on(address(port, "ok", touching), touching, patience=20.0)
    with drive.transport:
        for allow in ((), "path"):
            refused = drive.execute(touching, allow=allow)
            assert refused.status == "refused" and "margin" in refused.reason and "'contact'" in refused.advice
        assert drive.execute(touching, allow="contact").status == "dry_run"


def test_the_controllers_names_and_order_of_the_joints(port, plan):
    names = {name: f"arm/{name}" for name in plan.robot.joint_names}
    order = [*range(1, plan.robot.n), 0]
    theirs = ",".join(names[plan.robot.joint_names[i]] for i in order)
    url = address(port, "ok", plan, at=plan.trajectory(0.0)[order]).replace(",".join(plan.robot.joint_names), theirs)
    drive = drive_on(url, plan, joint_names=names, **PATIENT)
    quick = hop(0.8)
    with drive.transport:
        done = drive.execute(quick)
    assert done, done.reason
    np.testing.assert_allclose(done.q[-1], quick.trajectory(quick.trajectory.end), atol=1e-9)


def test_a_stop_that_cannot_be_certified_is_a_cancellation_and_is_said_before(port, plan, monkeypatch):
    def none(*_: Any) -> planners.Plan:
        raise NoSolution("no stop within the limits")

    monkeypatch.setattr(sys.modules[make_stops.__module__], "plan_stop_at", none)
    drive = drive_on(address(port, "ok", plan), plan, **PATIENT)
    with drive.transport:
        stopped = drive.execute(plan, stop=0.2)
    assert (stopped.status, stopped.stop_plan) == ("stopped", None), (stopped.reason, stopped.notes)
    assert "no stop from here could be certified" in stopped.reason
    assert any("; 0 stops were found" in note for note in stopped.notes)


def test_the_motion_of_a_law_without_jerk_limits_can_be_stopped():
    robot = optik.load("irb120")
    q, limits = robot.limits.middle, planners.MotionLimits(velocity=2.0, acceleration=10.0)
    smooth = planners.plan(robot, q + 0.2, q, limits=limits, timing="toppra", duration=1.5)
    stops = make_stops(make_message(smooth, None)[0], 0.5, None)
    assert len(stops.found) == 2 and all(stop.plan.certificate.is_valid for stop in stops.found), stops.reason


def test_stops_are_computed_before_the_arm_moves_and_in_bounded_time(plan, monkeypatch):
    sent, _ = make_message(hop(1.0), None)
    stops = make_stops(sent, 0.2, None)
    assert [round(stop.t, 9) for stop in stops.found] == [0.2, 0.4, 0.6, 0.8] and stops.reason == ""
    for stop in stops.found:  # each begins where the motion is, and keeps the limits as the controller interpolates
        first = stop.message["points"][0]
        np.testing.assert_allclose(first["positions"], sent.trajectory(stop.t), atol=1e-9)
        np.testing.assert_allclose(first["velocities"], sent.trajectory(stop.t, 1), atol=1e-9)
        assert stop.plan.certificate.is_valid and stop.plan.limits == sent.limits
    monkeypatch.setattr(sys.modules[make_stops.__module__], "PREPARING", 1e-6)
    assert len(make_stops(sent, 0.1, None).found) <= 2


def test_an_exception_of_the_caller_stops_the_arm(port, plan):
    def careless(moment):
        if moment.t > 0.2:
            raise KeyboardInterrupt

    drive = drive_on(address(port, "ok", plan), plan, **PATIENT)
    with drive.transport:
        with pytest.raises(KeyboardInterrupt):
            drive.execute(plan, watch=careless)
        reason, _ = drive.joints.wait_for_rest(20.0)  # waits until it stands
        assert reason == "" and np.abs(drive.measure() - plan.trajectory(4.0)).max() > 0.01


def test_a_server_that_never_answers_or_is_not_there(plan, capfd):
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        url = f"ws://127.0.0.1:{mute.getsockname()[1]}"
        since = time.monotonic()
        drive = RosDrive(plan.robot, RosbridgeTransport(url, timeout=0.3))
        assert "no rosbridge answers" in drive.execute(plan).reason
    assert "no rosbridge answers" in RosDrive(plan.robot, RosbridgeTransport(url, timeout=0.3)).execute(plan).reason
    assert time.monotonic() - since < 60.0
    assert drive.transport.send({}).refused == drive.transport.lost  # and nothing is sent later
    assert "Traceback" not in "".join(capfd.readouterr())
    assert all(thread.daemon for thread in threading.enumerate() if thread.name.startswith("roslibpy"))


def test_wrong_arguments(plan):
    for url in ("127.0.0.1:9090", "http://x:1", "ws://", "ws://x:99999", 7):
        with pytest.raises(InvalidInput, match=r"url.*ws://127\.0\.0\.1:9090"):
            RosbridgeTransport(url)
    with pytest.raises(InvalidInput, match="action"):
        RosbridgeTransport(action="no name")
    with pytest.raises(InvalidInput, match="a Transport"):
        RosDrive(plan.robot, "ws://127.0.0.1:9090")


def test_a_missing_package_is_named_with_the_way_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "roslibpy", None)
    with pytest.raises(MissingDependency, match=r"roslibpy.*optik-toolkit\[ros2\]"):
        RosbridgeTransport()
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(MissingDependency, match=r"rclpy.*source a ROS 2"):
        RclpyTransport()


def test_a_goal_through_rclpy(monkeypatch):
    plan = hop(0.6)
    ros = Rclpy(monkeypatch, plan)
    with RclpyTransport(timeout=20.0) as transport:
        done = RosDrive(plan.robot, transport, **PATIENT).execute(plan)
        assert done, (done.reason, done.notes)
        [goal] = ros.goals
        assert goal.trajectory.joint_names == list(plan.robot.joint_names) and len(goal.trajectory.points) > 2
        last = goal.trajectory.points[-1]
        assert last.time_from_start.sec + 1e-9 * last.time_from_start.nanosec == pytest.approx(0.60006)
        np.testing.assert_allclose(last.positions, plan.trajectory(plan.trajectory.end), atol=1e-12)
        ros.q = list(last.positions)
        ros.accepts = False
        way = planners.plan(plan.robot, plan.trajectory(0.0), np.array(ros.q), timing="ruckig", limits=plan.limits)
        back = RosDrive(plan.robot, transport, **PATIENT).execute(way)
        assert (back.status, back.fault.kind) == ("fault", "controller") and "rejected" in back.reason
        ros.accepts, ros.state = True, 6
        lost = RosDrive(plan.robot, transport, **PATIENT).execute(way)
        assert (lost.status, lost.fault.kind) == ("fault", "stall") and "goal tolerance" in lost.reason
        goal = transport.send(
            {"joint_names": [], "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}, "points": []}
        )
        transport.cancel(goal)
        assert ros.cancelled == 1
    assert transport.lost and ros.closed


# ---------------------------------------------------------------- stored motions, and the command line
def test_the_plan_of_a_stored_motion_can_be_stopped(tmp_path):
    robot = optik.load("paper6r")
    q = robot.limits.middle
    start = robot.fk(q)
    goal = start.copy()
    goal[:3, 3] += [-0.12, 0.0, 0.2]
    made = planners.plan(robot, goal, q, timing="quintic")
    made.save(tmp_path / "line.json")
    found = restore_plan(planners.load_motion(tmp_path / "line.json"))
    assert found and np.array_equal(found.trajectory.coefficients, made.trajectory.coefficients)
    s = np.linspace(0.0, made.joint_path.end, 50)
    np.testing.assert_allclose(found.joint_path(s), made.joint_path(s), atol=1e-6)
    assert planners.replan(found, 0.5 * found.trajectory.end, stop=True)
    hasty = replace(made.motion, limits=made.limits.scale(0.05), enforced=("velocity",))
    with pytest.raises(NoSolution, match="certificate of this motion is not valid"):
        restore_plan(hasty)


def typed(*words: str) -> tuple[int, str]:
    """Exit status and output of `optik drive`."""
    done = CliRunner().invoke(app, ["drive", *words])
    assert done.exception is None or isinstance(done.exception, SystemExit | OptikError), done.exception
    return done.exit_code, done.output + str(done.exception or "")


def test_the_command_line_checks_sends_and_reports(port, plan, tmp_path):
    file, out = str(tmp_path / "hop.json"), str(tmp_path / "done.json")
    hop(0.6).save(file)
    code, said = typed(file, "--on", "ros", "--url", address(port, "ok", plan))
    assert code == 0 and "nothing was sent" in said and "points of 0.60006 s" in said and "--execute" in said, said
    code, said = typed(file, "--on", "ros", "--url", address(port, "close", plan), "--execute", "--json")
    assert code == 1 and json.loads(said.rpartition("}")[0] + "}")["fault"]["kind"] == "connection", said
    code, said = typed(file, "--on", "ideal", "--execute", "--out", out)
    data = json.loads(Path(out).read_text())
    assert code == 0 and "--execute" in said and data["status"] == "done", said
    assert max(data["tracking"]) < 1e-5 and len(data["t"]) == len(data["q"])


@pytest.fixture(scope="module")
def stored(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("stored")
    hop(0.6).save(folder / "hop.json")
    (folder / "deep.json").write_text("[" * 100_000, encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["nix.json"], "nix.json"),
        (["hop.json", "--url", "ws://127.0.0.1:9090"], "--on: expected --on ros"),
        (["hop.json", "--on", "ros", "--url", "127.0.0.1"], "url: expected the address"),
        (["hop.json", "--on", "ros", "--via", "tcp"], "--via: expected rosbridge or rclpy"),
        (["hop.json", "--on", "ros", "--via", "rclpy", "--url", "ws://127.0.0.1:1"], "ws://127.0.0.1:1"),
        (["hop.json", "--on", "ros", "--joint-names", "a,b"], "--joint-names: expected 6 different names"),
        (["hop.json", "--on", "ros", "--joint-names", "a,b,c,d,e,a"], "got a,b,c,d,e,a"),
        (["hop.json", "--on", "idael"], "did you mean ideal"),
        (["hop.json", "--stop", "-1"], "--stop: expected a time"),
        (["hop.json", "--out", "done.csv"], "got done.csv"),
        (["hop.json", "--out", "../STORED/hop.json"], "--out: expected a file other"),
        (["deep.json"], "deep.json"),
    ],
)
def test_what_is_typed_wrong_is_named(stored, monkeypatch, words, why):
    monkeypatch.chdir(stored)
    before = (stored / "hop.json").read_bytes()
    code, said = typed(*(word.replace("STORED", stored.name) for word in words))
    assert code != 0 and why in said
    assert (stored / "hop.json").read_bytes() == before


def test_a_program_with_a_wait_and_events_is_executed_stopped_and_resumed(port):
    robot = optik.load("irb120")
    q, limits = robot.limits.middle, planners.MotionLimits(velocity=0.5, acceleration=5.0, jerk=100.0)
    parts = [
        planners.Part(q + 0.3, blend=0.01),
        planners.Part(q + np.array([0.5, 0.2, 0.3, 0.2, 0.3, 0.1]), name="there"),
    ]
    program = planners.Program([*parts, planners.program.Dwell(0.5), planners.Part(q)])
    found = planners.plan(robot, program, q, limits=limits)
    found = found.schedule(
        [planners.program.PathEvent("there", None, "gun", fraction=1.0), planners.program.TimedEvent(0.0, "on")]
    )
    drive = drive_on(address(port, "ok", found), found, **PATIENT)
    with drive.transport:
        stopped = drive.execute(found, stop=0.2)
        assert stopped.status == "stopped", (stopped.reason, stopped.notes)
        onward = drive.resume(stopped)
    assert onward.status == "done", (onward.reason, onward.notes)
    np.testing.assert_allclose(onward.q[-1], q, atol=1e-6)
    assert [event.signal for event in (*stopped.events, *onward.events)] == ["on", "gun"]
