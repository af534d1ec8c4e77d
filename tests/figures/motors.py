"""Arms with coupled motors: random motions judged at 20 kHz by formulas of their own, files, and goals inside the ranges."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import scipy

import optik
from optik.types import Array
from planners import JointLine, MotionLimits, load_motion, load_trajectory, plan, save, to_ros
from tests.figures.figure import Row, Value, main

COUNT, GOALS = 200, 20
"""Motions, and goals for inverse kinematics with each."""
ARMS, KINDS = ("ur5e", "puma560", "panda", "iiwa14"), ("joints 2 and 3", "differential wrist", "random")


def matrix(kind: str, n: int, rng: np.random.Generator) -> Array:
    C = np.eye(n)
    if kind == "joints 2 and 3":
        C[2, 1] = -1.0
    elif kind == "differential wrist":
        C[-2:, -2:] = [[0.5, 0.5], [0.5, -0.5]]
    else:
        C += 0.25 * rng.uniform(-1.0, 1.0, (n, n))
    return C


def measure(case: int) -> Row:
    rng, kind = np.random.default_rng([case, 5]), KINDS[case % 3]
    plain = optik.load(ARMS[case % 4])
    names = [f"M{i + 1}" for i in range(plain.n)]
    torque = plain.limits.torque if plain.inertia is not None else None
    robot = plain.with_limits(velocity=2.0, acceleration=10.0, jerk=100.0, torque=torque, torque_rate=None).with_motors(
        matrix(kind, plain.n, rng), names=names
    )
    motors, limits = robot.motors, robot.limits
    ends = motors.axes(motors.limits.sample(rng, 2, half_if_infinite=np.pi))
    path = JointLine(robot, *ends)
    found, E = plan(robot, path, ends[0]), np.linalg.inv(motors.matrix)
    row: Row = {"kind": kind, "ok": bool(found), "why": "" if found else found.failure.reason}
    solved = outside = said = 0
    for m in motors.limits.sample(rng, GOALS, half_if_infinite=np.pi):
        goal = optik.solve_ik(robot, robot.fk(motors.axes(m)), limits.middle)
        solved += bool(goal)
        outside += not goal
        said += not goal and "ranges of the motors" in goal.message
    row |= {"solved": solved, "outside": outside, "said": said}
    if not found:
        return row
    own = scipy.interpolate.PPoly(found.trajectory.coefficients, found.trajectory.knots)
    t = np.arange(0.0, found.duration, 1.0 / 20_000)
    q, v, a = own(t), own(t, 1), own(t, 2)
    ratios = [np.abs(own(t, k) @ E.T / b).max() for k, b in ((1, 2.0), (2, 10.0), (3, 100.0))]
    if torque is not None:
        few = slice(None, None, 20)
        tau = (
            robot.torques(q[few], v[few], a[few]) @ motors.matrix
            + motors.inertia * (a[few] @ E.T)
            + motors.viscous * (v[few] @ E.T)
        )
        tau += motors.coulomb * np.where(np.abs(v[few] @ E.T) > 1e-9, np.sign(v[few] @ E.T), np.sign(tau))
        ratios.append((np.abs(tau) / motors.limits.torque).max())
    m = (q - motors.offset) @ E.T
    inside = float(np.maximum(m - motors.limits.upper, motors.limits.lower - m).max())
    box = 1.0 / np.abs(E).sum(axis=1).max()
    inner = plan(robot, path, ends[0], limits=MotionLimits(2.0 * box, 10.0 * box, 100.0 * box))
    with TemporaryDirectory() as folder:
        for name in ("a.json", "a.csv"):
            save(found, Path(folder) / name)
        same = all(
            (load_motion(Path(folder) / x).trajectory.coefficients == found.trajectory.coefficients).all()
            for x in ("a.json", "a.csv")
        )
        lines = [x.split(",") for x in (Path(folder) / "a.csv").read_text().splitlines() if not x.startswith("#")]
        table = np.array(lines[1:], dtype=float)[:, : robot.n + 1]
        csv = float(np.abs(table[:, 1:] - (found.trajectory(table[:, 0]) - motors.offset) @ E.T).max())
        to_ros(found, Path(folder) / "a.yaml")
        ros = load_trajectory(Path(folder) / "a.yaml", robot)
        knots = found.trajectory.knots[:-1] * ros.end / found.duration
        away = float(np.abs(ros(knots) - found.trajectory(found.trajectory.knots[:-1])).max())
    return row | {
        "most": float(max(ratios)),
        "range": inside,
        "over_box": found.duration / inner.duration,
        "same": bool(same),
        "csv": csv,
        "ros": away,
    }


def judge(rows: list[Row]) -> list[Value]:
    ok = [row for row in rows if row["ok"]]
    held = sum("gravity" not in row["why"] for row in rows)
    most, files = max(row["most"] for row in ok), max(row["csv"] for row in ok)
    over = float(np.median([row["over_box"] for row in ok]))
    share = sum(row["solved"] for row in rows) / (GOALS * len(rows))
    unsaid = sum(row["outside"] - row["said"] for row in rows)
    return [
        Value("motions certified", "all", f"{len(ok)} of {held} that are held at rest", len(ok) == held),
        Value("largest ratio of a motor at 20 kHz", "≤ 1", f"{most:.9f}", most <= 1.0 + 1e-6),
        Value(
            "beyond the range of a motor",
            "≤ 1e-9",
            f"{max(row['range'] for row in ok):.2g}",
            max(row["range"] for row in ok) <= 1e-9,
        ),
        Value("duration over that of the box of motors inside", "≤ 0.85 (median)", f"{over:.3f}", over <= 0.85),
        Value(
            "JSON and CSV read back to the last bit; CSV in motors",
            "1e-12",
            f"{files:.2g}",
            files <= 1e-12 and all(row["same"] for row in ok),
        ),
        Value(
            "ROS message at its points",
            "1e-12",
            f"{max(row['ros'] for row in ok):.2g}",
            max(row["ros"] for row in ok) <= 1e-12,
        ),
        Value("goals inside the exact ranges solved", "≥ 95 %", f"{share:.1%}", share >= 0.95),
        Value("others refused in words", "all", f"{unsaid} are not", unsaid == 0),
    ]


if __name__ == "__main__":
    main("motors", measure, COUNT, judge, 0.2)
