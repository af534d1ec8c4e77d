"""Streams of set-points on simulated drives, and as goals on a stand-in for a controller of ROS 2."""

from __future__ import annotations

import json
import subprocess
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import optik
from benchmarks.cli.app import app
from optik.errors import InvalidInput
from planners import MotionLimits, stream
from planners.cell import IdealDrive
from planners.cell.drives import make_drive
from planners.cell.drives.ros import RosDrive
from planners.ros.rosbridge import RosbridgeTransport
from planners.streams import Chunk, Setpoint
from tests import forks
from tests.planners.faulty import Faulty, LostEncoder, Stall
from tests.planners.rosbridge_server import commanded

LIMITS = MotionLimits(velocity=1.5, acceleration=5.0, jerk=50.0)
START = np.array([0.0, -1.2, 1.4, -0.2, 0.5, 0.0])


class Chunks:
    """A chunk every 0.15 s until a time, each a little after its observation."""

    def __init__(self, until: float, start: np.ndarray = START) -> None:
        self.until, self.start, self.due = until, start, 0.0

    def intend(self, t: Any) -> np.ndarray:
        return self.start + 0.3 * np.sin(np.asarray(t)[..., None] * np.linspace(0.7, 1.6, self.start.size))

    def __call__(self, now: Setpoint) -> Chunk | None:
        if not self.due <= now.t <= self.until:
            return None
        self.due, seen = now.t + 0.15, max(now.t - 0.05, 0.0)
        return Chunk(self.intend(seen + np.arange(12) / 20.0), 20.0, seen)


@pytest.mark.parametrize(("name", "error"), [("ideal", 1e-5), ("mujoco", 2e-3)])
def test_a_simulated_arm_follows_a_stream_to_rest(name, error):
    robot = optik.load("ur5e")
    drive = make_drive(name, robot)
    source = Chunks(1.5)
    done = drive.follow(stream(robot, source, START, rate=250.0, limits=LIMITS, realtime=False, silence=0.2))
    assert done and done.report.joined >= 8 and done.error.max() < error
    assert np.abs(done.q[-1] - done.q[-10]).max() < 1e-4  # at rest
    inside = (done.t > 0.8) & (done.t < 1.5)
    assert np.abs(done.setpoints - source.intend(done.t))[inside].max() < 0.03
    again = drive.follow(
        stream(robot, Chunks(0.5, done.q[-1]), done.q[-1], rate=250.0, limits=LIMITS, realtime=False, silence=0.2)
    )
    assert again  # it stands where the first stream ended


def test_a_stream_of_another_rate_or_start_is_refused():
    robot = optik.load("ur5e")
    drive = make_drive("ideal", robot, q=START)
    with pytest.raises(InvalidInput, match="250: one for each period"):
        drive.follow(stream(robot, Chunks(1.0), START, limits=LIMITS, realtime=False))
    with pytest.raises(InvalidInput, match="joint"):
        drive.follow(stream(robot, Chunks(1.0), START + 0.1, rate=250.0, limits=LIMITS, realtime=False))


class FaultyIdealDrive(Faulty, IdealDrive):
    """An ideal arm with faults."""


@pytest.mark.parametrize("fault", [Stall(2, at=0.0), LostEncoder(2, at=0.0, frozen=True)])
def test_a_joint_that_does_not_follow_stops_the_stream(fault):
    robot = optik.load("ur5e")
    drive = FaultyIdealDrive(robot, START, faults=(fault,))
    done = drive.follow(stream(robot, Chunks(9.0), START, rate=250.0, limits=LIMITS, realtime=False))
    assert not done and robot.joint_names[2] in done.fault and done.t[-1] < 3.0


# ---------------------------------------------------------------- ROS


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    server = Path(__file__).with_name("rosbridge_server.py")
    with subprocess.Popen([sys.executable, str(server)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield int(process.stdout.readline())
        process.kill()


def test_each_motion_is_a_goal_that_continues_the_one_before(port, tmp_path):
    robot, trace = optik.load("ur5e"), tmp_path / "trace"
    url = f"ws://127.0.0.1:{port}/ok?id={uuid.uuid4()}&names={','.join(robot.joint_names)}"
    url += f"&q={','.join(map(str, START))}&trace={trace}"
    with RosbridgeTransport(url, timeout=20.0) as transport:
        drive = RosDrive(robot, transport, execute=True, patience=20.0, latency=0.4)
        flow = stream(robot, Chunks(2.0), START, rate=50.0, limits=LIMITS, budget=0.4, silence=0.4)
        done = drive.follow(flow)
        assert done and done.report.joined >= 3, (done.fault, done.report)
        with pytest.raises(InvalidInput, match="realtime"):
            drive.follow(stream(robot, Chunks(2.0), START, rate=50.0, limits=LIMITS, budget=0.4, realtime=False))
        with pytest.raises(InvalidInput, match="budget"):
            drive.follow(stream(robot, Chunks(2.0), START, rate=50.0, limits=LIMITS))
    q = commanded(trace, 0.01)
    v = np.diff(q, axis=0) / 0.01
    assert np.abs(v).max() <= 1.5 * (1.0 + 1e-3)
    assert np.abs(np.diff(v, axis=0)).max() / 0.01 <= 5.0 * (1.0 + 1e-2)  # no discontinuity between goals
    np.testing.assert_allclose(q[-1], done.setpoints[-1], atol=1e-6)


def test_a_refused_motion_stops_the_stream_and_a_dry_run_is_refused(port):
    robot = optik.load("ur5e")
    url = f"ws://127.0.0.1:{port}/reject?id={uuid.uuid4()}&names={','.join(robot.joint_names)}&q={','.join(map(str, START))}"
    with RosbridgeTransport(url, timeout=20.0) as transport:
        drive = RosDrive(robot, transport, execute=True, patience=20.0, latency=0.1)
        done = drive.follow(stream(robot, Chunks(3.0), START, rate=50.0, limits=LIMITS, budget=0.1, silence=0.2))
        assert not done and "refused" in done.fault
        with pytest.raises(InvalidInput, match="execute"):
            RosDrive(robot, transport).follow(stream(robot, Chunks(3.0), START, limits=LIMITS))


def test_what_a_source_raises_is_the_fault_of_the_record_and_the_sent_motion_ends_at_rest(port, tmp_path):
    robot, trace, chunks = optik.load("ur5e"), tmp_path / "trace", Chunks(9.0)

    def source(now: Setpoint) -> Chunk | None:
        if now.t > 2.2:
            raise KeyError("camera")
        return chunks(now)

    url = f"ws://127.0.0.1:{port}/ok?id={uuid.uuid4()}&names={','.join(robot.joint_names)}"
    url += f"&q={','.join(map(str, START))}&trace={trace}"
    # a motion arrives in time on a busy machine, too: it is sent a second before it begins
    with RosbridgeTransport(url, timeout=20.0) as transport:
        drive = RosDrive(robot, transport, execute=True, patience=20.0, latency=1.0)
        done = drive.follow(stream(robot, source, START, rate=50.0, limits=LIMITS, budget=1.0))
    assert not done and done.fault == "KeyError: 'camera'" and done.report.joined >= 1 and done.t[-1] > 3.0
    q = commanded(trace, 0.01)
    np.testing.assert_allclose(q[-1], done.setpoints[-1], atol=1e-6)
    assert np.abs(q[-1] - q[-3]).max() < 1e-3 < np.abs(q[-1] - START).max()


# ---------------------------------------------------------------- the command line


def write_chunks(file: Path) -> None:
    source, rows = Chunks(1.0), ["observed,index," + ",".join(f"q{i}_deg" for i in range(1, 7))]
    for seen in (0.0, 0.2, 0.5, 0.7):
        for i, q in enumerate(np.rad2deg(source.intend(seen + np.arange(15) / 20.0))):
            rows.append(f"{seen},{i}," + ",".join(f"{x:.6f}" for x in q))
    file.write_text("\n".join(rows))


def test_the_command_streams_a_file(tmp_path):
    file, out = tmp_path / "chunks.csv", tmp_path / "out.csv"
    write_chunks(file)
    typed = ["stream", str(file), "--robot", "ur5e", "--acceleration", "5", "--jerk", "50", "--on", "mujoco"]
    said = CliRunner().invoke(app, [*typed, "--out", str(out), "--json"])
    assert said.exit_code == 0, said.output
    data = json.loads(said.stdout)
    assert data["report"]["joined"] == 4 and data["fault"] == "" and max(data["error"]) < 2e-3
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    assert rows.shape[1] == 13 and np.abs(rows[:, 1:7] - rows[:, 7:]).max() < 2e-3
    said = CliRunner().invoke(app, typed)
    assert said.exit_code == 0 and "4 targets joined" in said.stdout


@pytest.mark.parametrize(
    ("more", "words"),
    [(["--on", "nothing"], "--on"), (["--rate", "0"], "--rate"), (["--latency", "-1"], "--latency"),
     (["--pace", "0"], "--pace"), (["--out", "a.txt"], "--out"), (["--jerk", "-1"], "--jerk"),
     (["--tolerance", "0"], "--tolerance")],
)  # fmt: skip
def test_a_mistyped_option_is_named_in_one_line(tmp_path, more, words):
    file = tmp_path / "chunks.csv"
    write_chunks(file)
    typed = ["stream", str(file), "--robot", "ur5e", "--acceleration", "5", "--jerk", "50"]
    said = forks.command(*typed, *more)
    assert said.returncode == 2 and said.stdout == ""
    assert said.stderr.startswith(f"error: {words}: ") and said.stderr.count("\n") <= 1, said.stderr
