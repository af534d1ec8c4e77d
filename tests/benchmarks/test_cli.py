"""The command line as people type it: in a process of its own, rightly and wrongly."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import optik
import planners
from benchmarks.cli.app import app
from benchmarks.cli.plan import describe_effort
from optik.registry import names
from tests.benchmarks.conftest import optik_process
from tests.oracles import REPOSITORY

START = "20,-35,40,25,50,-30"


def test_robots_lists_every_robot(typed: Any) -> None:
    status, out, _ = typed("robots", "--json")
    assert status == 0
    assert [r["name"] for r in json.loads(out)] == list(optik.robots())


def test_no_solution_is_exit_status_one(typed: Any) -> None:
    status, _, said = typed("ik", "--xyz", "30,0,0", "--start-deg", START)
    assert status == 1
    assert "not solved" in said and "millimetres?" in said  # 30 m is more than 20 times the reach
    assert "millimetres?" not in typed("ik", "--xyz", "3,0,0", "--start-deg", START)[2]
    assert "OUTSIDE the joint limits: joint2, joint4" in " ".join(typed("fk", "0,100,0,-100,0,0")[1].split())
    status, _, said = typed("plan", "line", "--move", "1,1,1", "--start-deg", START)
    assert status == 1
    assert said.count("\n") == 1
    assert "s = " in said and "; try: a path that ends before s = " in said
    status, _, said = typed("plan", "joints", "--to-deg", START, "--start-deg", START)
    assert status == 1 and "no solution: the path has a length of 0: start and goal are equal" in said
    status, _, said = typed("plan", "line", "--turn-deg", "0,90,0", "--start-deg", START)
    assert status == 1
    assert "joint4" in said and "[-90, 90]°" in said  # degrees, as typed


def test_a_drive_says_why_a_torque_may_exceed_its_bound(tmp_path: Path, typed: Any) -> None:
    pytest.importorskip("mujoco")
    file, why = str(tmp_path / "move.json"), "the torque can exceed the bound of the planned motion"
    assert typed("plan", "joints", "--to-deg", "25,-35,40,25,50,-30", "--out", file)[0] == 0
    assert why in typed("drive", file, "--on", "mujoco")[1]
    assert why not in typed("drive", file)[1]  # without torques


def test_plan_line_certifies_and_writes_what_it_prints(tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    done = optik_process("plan", "line", "--timing", "ruckig", "--out", str(file), "--json")
    assert done.returncode == 0
    printed = json.loads(done.stdout)
    assert printed["certificate"]["is_valid"] is True
    assert max(printed["certificate"]["jerk"]["ratio"]) <= 1.0
    again = planners.load_motion(file)
    assert again.trajectory.duration == printed["duration"]
    assert again.certify().to_dict()["jerk"] == printed["certificate"]["jerk"]


def inside(*arguments: str) -> Result:
    """The same in this process: half of a command's time is its imports."""
    return CliRunner().invoke(app, list(arguments))


def test_plan_arc_goes_through_its_point_and_keeps_the_tool_speed(tmp_path: Path) -> None:
    robot = optik.load("paper6r")
    T = robot.fk(np.deg2rad([float(v) for v in START.split(",")]))
    p, side, up = T[:3, 3], np.array([0.02, 0.0, 0.0]), np.array([0.0, 0.0, 0.02])
    via, goal = p + side + up, p + 2.0 * side
    words = [",".join(f"{v:.9f}" for v in point) for point in (via, goal)]
    file = tmp_path / "arc.npz"
    done = inside(
        "plan", "arc", "--via", words[0], "--to", words[1], "--tool-speed", "0.05", "--out", str(file), "--json"
    )
    assert done.exit_code == 0, done.output
    proof = json.loads(done.stdout)["certificate"]
    assert proof["is_valid"] is True
    assert 0.99 < proof["tool_speed"]["ratio"] <= 1.0
    tool = robot.fk(planners.load_motion(file).trajectory.sample(1000)[1])[:, :3, 3]
    assert np.linalg.norm(tool - via, axis=1).min() < 1e-4
    np.testing.assert_allclose(tool[-1], goal, atol=1e-8)


def test_plan_about_an_axis_turns_by_the_angle() -> None:
    T = optik.load("paper6r").fk(np.deg2rad([float(v) for v in START.split(",")]))
    centre = ",".join(f"{v:.9f}" for v in T[:3, 3] + [0.05, 0.0, 0.0])
    done = inside("plan", "arc", "--centre", centre, "--angle-deg", "-20", "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["path"]["path"] == "arc"


def test_plan_polyline_passes_its_corner_within_the_blend(tmp_path: Path) -> None:
    robot = optik.load("paper6r")
    p = robot.fk(np.deg2rad([float(v) for v in START.split(",")]))[:3, 3]
    corner, end = p + np.array([0.03, 0.0, 0.0]), p + np.array([0.03, 0.0, 0.03])
    words = [",".join(f"{v:.9f}" for v in point) for point in (corner, end)]
    file = tmp_path / "corner.csv"
    done = inside("plan", "polyline", "--via", words[0], "--via", words[1], "--blend", "0.002", "--out", str(file))
    assert done.exit_code == 0, done.output
    tool = robot.fk(planners.load_motion(file).trajectory.sample(1000)[1])[:, :3, 3]
    assert 1e-5 < np.linalg.norm(tool - corner, axis=1).min() < 2e-3 + 1e-6
    np.testing.assert_allclose(tool[-1], end, atol=1e-8)


def test_plan_polyline_begins_at_the_first_waypoint_of_a_table(tmp_path: Path) -> None:
    robot, q = optik.load("paper6r"), np.deg2rad([float(v) for v in START.split(",")])
    T, x = robot.fk(q), np.linspace(0.02, 0.06, 30)
    points = T[:3, 3] + np.stack([x, 0.2 * np.abs(x - 0.04), 0.0 * x], axis=1)
    table, file = tmp_path / "seam.csv", tmp_path / "seam.json"
    axis = ",".join(f"{-v:.6f}" for v in T[:3, 2])
    rows = "".join(f"{','.join(f'{1e3 * v:.4f}' for v in p)},{axis}\n" for p in points)
    table.write_text(f"X_mm,Y_mm,Z_mm,I,J,K\n{rows}")
    done = inside("plan", "polyline", "--waypoints", str(table), "--timing", "constant_speed", "--out", str(file))
    assert done.exit_code == 0, done.output
    assert "start of the motion: --start-deg" in done.output and "start of paper6r" not in done.output
    motion = planners.load_motion(file)
    np.testing.assert_allclose(motion.path.pose(0.0)[:3, 3], points[0], atol=1e-7)
    tool = robot.fk(motion.trajectory.sample(1000)[1])
    np.testing.assert_allclose(tool[-1, :3, 3], points[-1], atol=1e-6)
    assert np.linalg.norm(tool[:, None, :3, 3] - points, axis=2).min(axis=0).max() < 1e-3
    assert np.abs(tool[:, :3, 2] - T[:3, 2]).max() < 1e-5


def test_plan_spline_passes_near_the_points_of_a_table(tmp_path: Path) -> None:
    robot, q = optik.load("paper6r"), np.deg2rad([float(v) for v in START.split(",")])
    T, x = robot.fk(q), np.linspace(0.0, 0.06, 40)
    points = T[:3, 3] + np.stack([x, 0.01 * np.sin(50.0 * x), 0.0 * x], axis=1)
    points[1:] += 3e-5 * np.random.default_rng(1).normal(size=(39, 3))
    table, file = tmp_path / "scan.csv", tmp_path / "scan.json"
    table.write_text("x_mm,y_mm,z_mm\n" + "".join(f"{','.join(f'{1e3 * v:.6f}' for v in p)}\n" for p in points))
    given = ("plan", "spline", "--waypoints", str(table), "--tolerance", "0.15,0.1", "--out", str(file))
    done = inside(*given, "--timing", "constant_speed")
    assert done.exit_code == 0, done.output
    tool = robot.fk(planners.load_motion(file).trajectory.sample(5000)[1])[:, :3, 3]
    assert np.linalg.norm(tool[:, None] - points, axis=2).min(axis=0).max() < 1.6e-4


TWO = """<robot name="two"><link name="base"/><link name="a"/><link name="b"/>
<joint name="j1" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit velocity="3" effort="9"/>
</joint><joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="3" effort="9"/></joint></robot>"""
LOG = "time_from_start;a1;a2;effort\n0,25;3,12;0;1\n0,5;-3,1;0;1\n0,75;-3,05;0,1;1\n"


@pytest.mark.filterwarnings("always::optik.errors.AssumptionWarning")
def test_certify_reads_a_table_of_another_program(tmp_path: Path, typed: Any) -> None:
    (arm := tmp_path / "two.urdf").write_text(TWO)
    (log := tmp_path / "log.csv").write_text(LOG)
    given = ["certify", str(log), "--robot", str(arm), "--acceleration", "1000", "--interpolation", "spline"]
    for option in (
        ["--columns", "time_from_start,j1,j2,effort"], ["--ignore", "effort"], ["--start-deg", "178.2,0"],
        ["--unwrap", "j1"],
    ):  # fmt: skip
        status, _, said = typed(*given)
        assert status == 2 and said.count("error:") == 1 and said.strip().count("\n") == 0, said
        if option[0] != "--columns":  # each error names the option that is added next
            assert " ".join(option[:1] + [option[1]] * (option[0] != "--start-deg")) in said, said
        given += option
    status, out, said = typed(*given)
    assert status == 0 and "certificate valid" in out and "log.csv: 0.7500 s" in out and "path error" not in out
    words = ["the columns time_from_start,a1,a2,effort are read as", "decimal commas", "at rest at the start"]
    assert all(each in said for each in words), said
    status, out, _ = typed(*given, "--json")
    data = json.loads(out)
    assert typed(*given, "--velocity", "0.1")[0] == 1
    assert status == 0 and len(data["notes"]) == 4 and data["duration"] == 0.75
    turned = np.array([178.2 * np.pi / 180.0, 3.12, -3.1 + 2.0 * np.pi, -3.05 + 2.0 * np.pi])
    assert data["velocity"]["value"][0] == pytest.approx(
        planners.load_trajectory(
            log, optik.load(arm), columns="time_from_start,j1,j2,effort", ignore="effort", start=[turned[0], 0.0],
            unwrap="j1", interpolation="spline",
        ).extrema(1).worst[0]
    )  # fmt: skip


def test_waypoints_of_another_program_are_refused_with_the_option(tmp_path: Path, typed: Any) -> None:
    (file := tmp_path / "seam.csv").write_text("x,y,z,feed\n400,0,300,1\n450,50,300,1\n")
    given = ["plan", "polyline", "--waypoints", str(file), "--robot", "ur5e", "--jerk", "50"]
    for option in (["--ignore", "feed"], ["--unit", "mm"]):
        status, _, said = typed(*given)
        assert status == 2 and " ".join(option) in said
        given += option
    assert typed(*given)[0] in (0, 1)
    status, _, said = typed(*given, "--columns", "x,y,feed")
    assert status == 2 and "line 2" in said


def test_plan_polyline_keeps_a_speed_for_each_segment() -> None:
    p = optik.load("paper6r").fk(np.deg2rad([float(v) for v in START.split(",")]))[:3, 3]
    words = [",".join(f"{v:.9f}" for v in p + np.array(move)) for move in ([0.03, 0.0, 0.0], [0.03, 0.0, 0.03])]
    polyline = ("plan", "polyline", "--via", words[0], "--via", words[1], "--timing", "toppra", "--json")
    done = inside(*polyline, "--tool-speed", "0.05,0.1")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["limits"]["tool_speed"] == [0.05, 0.1]
    assert 0.99 < found["certificate"]["tool_speed"]["ratio"] <= 1.0
    assert 0.06 < found["certificate"]["tool_speed"]["value"] <= 0.1


def test_plan_joints_lasts_as_long_as_asked_and_writes_a_ros_message(tmp_path: Path) -> None:
    file = tmp_path / "joints.yaml"
    done = inside("plan", "joints", "--to-deg", "0,0,10,0,30,0", "--duration", "4", "--out", str(file), "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["duration"] == pytest.approx(4.0)
    assert "joint_names" in file.read_text()


def test_a_joint_without_limits_is_turned_the_short_way_or_exactly(tmp_path: Path) -> None:
    file = tmp_path / "turn.urdf"
    file.write_text(
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/><joint name="j" type="continuous"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/></joint><joint name="k" type="revolute"><parent link="b"/><child link="c"/>'
        '<origin xyz="0.4 0 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="0" velocity="0"/></joint></robot>'
    )
    rates = ("--velocity", "1", "--acceleration", "5", "--jerk", "50")
    move = ("plan", "joints", "--robot", str(file), "--start-deg", "172,10", "--to-deg=-172,10", *rates)
    for further, goal in ((), "188,10"), (("--exact-winding",), "-172,10"):
        done = inside(*move, *further)
        assert done.exit_code == 0, done.output
        assert f"goal of the motion: {goal} [degrees" in done.output


def test_a_rounding_error_is_no_energy() -> None:
    plan = planners.plan(optik.load("paper6r"), [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], np.zeros(6), timing="smooth")
    energy = plan.certificate.energy._replace(net=-3.87e-13)
    words = describe_effort(replace(plan.certificate, energy=energy), plan.robot)
    assert " J (0 J if braking returns energy)" in words


def test_a_law_that_promises_nothing_is_not_praised() -> None:
    done = inside("plan", "line", "--timing", "quintic")
    assert done.exit_code == 0, done.output
    words = " ".join(done.output.split())
    exceeded = words.partition("not enforced by quintic")[2]
    assert "acceleration" in exceeded and "4.2" in exceeded and "jerk" in exceeded and "192" in exceeded


def test_bench_list_lists_every_suite(typed: Any) -> None:
    assert [s["name"] for s in json.loads(typed("bench", "list", "--json")[1])] == list(names("benchmarks.suites"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fk", "1,2"], "Q_DEG"),
        (["fk", "nan,0,0,0,0,0"], "finite"),
        (["fk", "0,0,0,0,0,0", "--robot", "paper7r"], "paper6r"),
        (["ik", "--xyz", "0,0,1", "--solver", "dsl"], "did you mean dls"),
        (["ik", "--xyz", "0,0,1", "--start-deg", "a,b"], "--start-deg"),
        (["plan", "line", "--start-deg", "190,0,0,0,0,0"], "joint1"),
        (["plan", "line", "--timing", "ruckg"], "did you mean ruckig"),
        (["plan", "line", "--velocity", "0"], "velocity"),
        (["plan", "line", "--jerk", "nan"], "jerk"),
        (["ik", "--xyz", "0.1,0.3,0.2", "--restarts", "100000000000000000000000000"], "--restarts"),
        (["plan", "line", "--robot", "ur5e", "--start-deg", "10,-80,90,20,30,40"], "--jerk"),
        (["plan", "line", "--robot", "kr6", "--start-deg", "10,-80,90,20,30,40"], "--acceleration"),
        (["plan", "line", "--out", "plan.txt"], ".json"),
        (["plan", "line", "--branch", "any"], "branch"),
        (["plan", "line", "--robot", "panda", "--start-deg", "1,2,3,4,5,6"], "expected 7 joint values of panda"),
        (["plan", "line", "--start-deg", "1,2"], "expected 6 joint values"),
        (["plan", "joints", "--to-deg", ""], "--to-deg"),
        (["plan", "line", "--start-deg", "1,2"], "such as 1,-2.5,3,1,-2.5,3; got"),
        (["plan", "ptp", "--waypoints", "none.csv"], "--waypoints: expected a readable file; got 'none.csv'"),
        (["plan", "line", "-r", "panda", "--scene", "none.yaml"], "--scene: expected a readable file of a scene"),
        (["plan", "line", "-r", "panda", "--scene", "none.txt"], "--scene: expected a name that ends in"),
        (["plan", "line", "--tool-speed", "0"], "--tool-speed"),
        (["plan", "line", "--tool-speed", "fast"], "--tool-speed"),
        (["plan", "line", "--tool-speed", "0.1,0.2"], "a line has one segment"),
        (["plan", "arc", "--via", "1,2,3"], "--via with --to, or --centre"),
        (["plan", "arc", "--via", "1,2,3", "--to", "1,2"], "3 or 6 numbers"),
        (["plan", "polyline", "--via", "a,b,c"], "--via"),
        (["plan", "polyline"], "--waypoints FILE.csv"),
        (["plan", "polyline", "--via", "1,2,3", "--waypoints", "a.csv"], "both"),
        (["plan", "polyline", "--waypoints", "no_such.csv"], "no_such.csv"),
        (["plan", "joints", "--to-deg", "0,0,0,0,0,190"], "--to-deg"),
        (["plan", "line", "--turn-deg", "0,0,360"], "180"),
        (["plan", "line", "--move", "1e300,0,0"], "1e6 m"),
        (["plan", "line", "--samples", "1000000000"], "samples"),
        (["plan", "line", "--json", "--out", "/proc/no/plan.json"], "cannot be written"),
        (["plan", "line", "--out", "/proc/no/plan.json"], "cannot be written"),
        (["bench", "run", "papers", "--out", "x"], "did you mean paper"),
        (["bench", "run", "paper", "--out", "/proc/no"], "cannot be written"),
        (["bench", "run", "paper", "--out", "."], "something else"),
        (["bench", "run", "paper", "--out", "x", "--workers", "0"], "workers"),
        (["bench", "run", "paper", "--out", "x", "--workers", "100000000000000000000000"], "workers"),
        (["bench", "run", "ik-sped", "--out", "x"], "did you mean ik-speed"),
        (["bench", "run", "ik-speed", "--out", "/proc/no"], "cannot be written"),
        (["bench", "report", "."], "bench run"),
        (["demo", "--out", "/proc/no"], "cannot be written"),
    ],
)
def test_misuse_is_one_line_and_exit_status_two(arguments: list[str], words: str, typed: Any) -> None:
    status, out, said = typed(*arguments)
    assert status == 2, said
    assert words in said
    assert "Traceback" not in said
    assert said.strip().count("\n") == 0
    assert out == ""


def test_unknown_options_are_exit_status_two(typed: Any) -> None:
    status, _, said = typed("plan", "line", "--sampels", "3")
    assert (status, "--samples" in said) == (2, True)


def test_what_ik_prints_for_a_sliding_joint_is_what_fk_takes(typed: Any) -> None:
    q = np.array([0.3, 0.9, 0.12, -0.4])
    scara = optik.load("irb910sc")
    x, y, z = (str(v) for v in scara.fk(scara.limits.clip(q))[:3, 3])
    _, out, _ = typed(
        "ik", "-r", "irb910sc", "--xyz", f"{x},{y},{z}", "--task", "position", "--solver", "dls", "--json"
    )
    answer = json.loads(out)
    assert answer["solved"]
    assert [unit == "mm" for unit in answer["q_deg_units"]] == scara.prismatic.tolist()
    units = np.where(scara.prismatic, 1e3, 180.0 / np.pi)
    np.testing.assert_allclose(answer["q_deg"], np.array(answer["q"]) * units, atol=1e-12)
    _, back, _ = typed("fk", "-r", "irb910sc", ",".join(str(v) for v in answer["q_deg"]), "--json")
    np.testing.assert_allclose(np.array(json.loads(back)["pose"])[:3, 3], [float(v) for v in (x, y, z)], atol=1e-5)


def into(target: str, *arguments: str, unbuffered: str = "") -> tuple[int, str]:
    """Exit status and errors of a command whose standard output goes to a file, or to a reader that has gone."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"} | {"PYTHONPATH": str(REPOSITORY)}
    environment |= {"PYTHONUNBUFFERED": unbuffered} if unbuffered else {}
    if target:
        out = os.open(target, os.O_WRONLY)
    else:
        read, out = os.pipe()
        os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.cli", *arguments], stdout=out, stderr=subprocess.PIPE, text=True,
        timeout=300, env=environment,
    )  # fmt: skip
    os.close(out)
    return done.returncode, done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux that is always full")
@pytest.mark.parametrize(("arguments", "unbuffered"), [(("robots",), ""), (("robots", "--json"), "1")])
def test_an_output_that_is_full_is_one_line_and_exit_status_two(arguments: tuple[str, ...], unbuffered: str) -> None:
    status, words = into("/dev/full", *arguments, unbuffered=unbuffered)
    assert status == 2
    assert words.splitlines() == ["error: standard output: No space left on device"]


@pytest.mark.skipif(os.name != "posix", reason="pipes as POSIX has them")
def test_a_reader_that_has_gone_changes_no_exit_status() -> None:
    assert into("", "robots") == (0, "")
    status, _ = into("", "ik", "--xyz", "3,0,0", "--json")
    assert status == 1
