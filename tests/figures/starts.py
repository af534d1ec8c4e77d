"""Straight lines of public arms by 100 mm along x, y and −z from the start that is chosen, in Python and by the command line.

The environment variables ``ARMS`` and ``ARMS_TABLE`` name a folder with one URDF for each arm, NAME.urdf, and a CSV with the
columns ``arm``, ``tip a user wants``, ``tip today`` and ``used for``: arms used for ``lines`` count. ``BEFORE`` names the kept
results of an older version: what it solved must be solved. A line counts as solved if the arm's own points at 200 Hz are
within 0.1 mm of it, by Pinocchio, and inside the ranges.
"""

from __future__ import annotations

import csv
import io
import json
import os
import warnings
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import typer

import optik
import planners
from benchmarks.cli.paths import LineCommand
from optik.types import Array
from planners import Line, MotionLimits
from tests.figures.figure import Row, Value, main

MOVES = {"+x": (0.1, 0.0, 0.0), "+y": (0.0, 0.1, 0.0), "-z": (0.0, 0.0, -0.1)}
ASKED = 260.0 / 270.0
LIMITS = {"acceleration": 10.0, "jerk": 100.0}


def list_arms() -> list[dict[str, str]]:
    """The rows of the arms used for lines whose file is there."""
    with Path(os.environ["ARMS_TABLE"]).open() as opened:
        rows = [row for row in csv.DictReader(opened) if "lines" in row["used for"]]
    return [row for row in rows if file_of(row["arm"]).exists()]


def file_of(name: str) -> Path:
    return Path(os.environ["ARMS"]) / f"{name}.urdf"


def load(row: dict[str, str]) -> tuple[optik.Robot, str]:
    """The arm with the tip that is wanted, if its file has it."""
    file = file_of(row["arm"])
    text = file.read_text(errors="replace")
    tips = [tip for tip in (row["tip a user wants"], row["tip today"]) if f'<link name="{tip}"' in text]
    return optik.load(file, tip=next(iter(tips), None)), next(iter(tips), "")


def follows(file: Path, tip: str, robot: optik.Robot, found: Any, line: Line) -> bool:
    """Whether a motion's points are inside the ranges and on its line, by Pinocchio and up to the frame of the base."""
    model = pin.buildModelFromUrdf(str(file))
    data, frame = model.createData(), model.getFrameId(tip, pin.FrameType.BODY)
    q = found(np.linspace(0.0, found.duration, 1 + int(200.0 * found.duration)))
    poses = np.array([place(model, data, robot, frame, each) for each in q])
    way = robot.fk(q[0])[:3, :3] @ poses[0, :3, :3].T @ (poses[:, :3, 3] - poses[0, :3, 3]).T
    asked = line.pose(line.end)[:3, 3] - line.pose(0.0)[:3, 3]
    along = np.clip(asked @ way / (asked @ asked), 0.0, 1.0)
    off = np.linalg.norm(way - asked[:, None] * along, axis=0).max()
    return bool(off <= 1e-4 and np.linalg.norm(way[:, -1] - asked) <= 1e-4 and robot.limits.contains(q).all())


def place(model: Any, data: Any, robot: optik.Robot, frame: int, q: Array) -> Array:
    """The pose of a link in the root's frame at joint values by name, the others in their neutral position."""
    x = pin.neutral(model)
    for name, value in zip(robot.joint_names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        x[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(value), np.sin(value)) if joint.nq == 2 else value
    pin.framesForwardKinematics(model, data, x)
    return np.asarray(data.oMf[frame].homogeneous)


def typed(row: dict[str, str], tip: str, move: tuple[float, ...], limits: dict[str, float]) -> tuple[bool, str]:
    """Whether the command solves the line, and its last line of output."""
    out, said = io.StringIO(), io.StringIO()
    words = {"robot": str(file_of(row["arm"])), "tip": tip or None, "move": ",".join(map(str, move))}
    with redirect_stdout(out), redirect_stderr(said):
        try:
            LineCommand(**words, **limits, as_json=True).run()
        except typer.Exit as ended:
            return ended.exit_code == 0, str(json.loads(out.getvalue()).get("reason"))[:200]
    raise AssertionError("a command ends with its status")


def measure(case: int) -> Row:
    row = list_arms()[case]
    warnings.simplefilter("ignore")
    robot, tip = load(row)
    limits = dict(LIMITS)
    if robot.limits.velocity is None or not np.isfinite(robot.limits.velocity).all():
        limits["velocity"] = 1.0
    q, out = optik.choose_start(robot), {}
    T = robot.fk(q)
    for name, move in MOVES.items():
        line = Line(T, optik.se3.pose(T[:3, :3], T[:3, 3] + move))
        found = planners.plan(robot, line, q, limits=MotionLimits.of(robot, **limits))
        solved = bool(found) and follows(file_of(row["arm"]), tip or robot_tip(robot), robot, found.trajectory, line)
        by_command, reason = typed(row, tip, move, limits)
        out[name] = {
            "api": solved,
            "claimed": bool(found),
            "cli": by_command,
            "why": str(found.failure and found.failure.reason)[:200],
            "said": reason,
        }
    return {"arm": row["arm"], "joints": robot.n, "start": np.degrees(q).round(1).tolist(), "moves": out}


def robot_tip(robot: optik.Robot) -> str:
    """The tip that a rule chose, from the sentence on the arm's source."""
    return robot.source.split(" to ", 1)[1].split(",")[0]


def judge(rows: list[Row]) -> list[Value]:
    values, count = [], 3 * len(rows)
    least = int(np.ceil(ASKED * count))
    for key, what in (("api", "in Python"), ("cli", "by the command line")):
        good = sum(one[key] for row in rows for one in row["moves"].values())
        values.append(Value(f"lines solved {what}", f"≥ {least} of {count}", str(good), good >= least))
    wrong = sum(one["claimed"] and not one["api"] for row in rows for one in row["moves"].values())
    values.append(Value("motions off their line or range", "0", str(wrong), not wrong))
    for row in rows:
        for name, one in row["moves"].items():
            if not (one["api"] and one["cli"]):
                print(f"  {row['arm']} {name}: Python {one['api']}, command {one['cli']}: {one['why'] or one['said']}")
    if "BEFORE" in os.environ:
        before = {
            row["arm"]: row["moves"] for row in map(json.loads, Path(os.environ["BEFORE"]).read_text().splitlines())
        }
        both = [(row["arm"], name, key) for row in rows for name in MOVES for key in ("api", "cli")]
        now = {row["arm"]: row["moves"] for row in rows}
        lost = [" ".join(at) for at in both if before[at[0]][at[1]][at[2]] and not now[at[0]][at[1]][at[2]]]
        values.append(Value("solved before, not now", "0", f"{len(lost)}: {', '.join(lost)}", not lost))
    return values


if __name__ == "__main__":
    main("starts", measure, len(list_arms()), judge)
