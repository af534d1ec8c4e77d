"""Lines that exist only by their freedom: certified, how long the sequence takes to find, and the time laws along them.

A case sweeps a smooth joint motion, takes the tool's path, and turns the tool away from it inside the freedom. The given path
cannot be followed from the start, or at all; the freedom makes it possible. The known motion is forgotten. The oracle is
another forward kinematics: the tool must be on the given path after the freedoms are undone.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import optik
import planners
from optik.types import Array
from planners import MotionLimits, Polyline
from tests.figures.figure import ROOT, Row, Value, main

SEED, CASES, POSES, DENSE = 20261128, 200, 40, 400
ARMS = ("paper6r", "ur5e", "panda", "urdf")
LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
LAWS = "optimal", "constant_speed"
TURN, TILT = 1.8, 0.4


def arm(name: str) -> optik.Robot:
    return optik.Robot.from_urdf(ROOT / "examples" / "arm.urdf") if name == "urdf" else optik.load(name)


def draw(robot: optik.Robot, rng: np.random.Generator) -> tuple[Array, Array, bool]:
    """Return poses (k, 4, 4) turned away from a joint motion, its start, and whether the tool is tilted, too."""
    while True:
        way = [robot.limits.sample(rng, 1)[0] * 0.7 + 0.3 * robot.limits.middle]
        way += [way[0] + rng.uniform(-0.5, 0.5, robot.n) for _ in range(2)]
        spline = CubicSpline((0.0, 0.5, 1.0), way)
        q, dense = spline(np.linspace(0.0, 1.0, POSES)), spline(np.linspace(0.0, 1.0, DENSE))
        poses = robot.fk(q)
        length = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        regular = robot.singular_values(dense)[:, -1].min() > 0.02
        if robot.limits.contains(dense).all() and length.min() > 1e-3 and regular:
            break
    tilted = bool(rng.random() < 0.5)
    u = np.linspace(0.0, 1.0, POSES)
    turn = rng.choice((-1.0, 1.0)) * 0.9 * TURN * np.sin(np.pi * u * rng.uniform(0.5, 1.5))
    tilt = 0.7 * TILT * np.sin(np.pi * u)[:, None] * rng.normal(size=2) / 2.0 * tilted
    # given · Rz(turn) · Rx · Ry = tool
    undo = (
        Rotation.from_euler("z", turn[:, None])
        * Rotation.from_euler("x", tilt[:, :1])
        * Rotation.from_euler("y", tilt[:, 1:])
    )
    poses[:, :3, :3] = poses[:, :3, :3] @ np.swapaxes(undo.as_matrix(), 1, 2)
    return poses, q[0], tilted


def measure(case: int) -> Row:
    name, rng = ARMS[case % len(ARMS)], np.random.default_rng([SEED, case])
    robot = arm(name)
    while True:
        poses, q, tilted = draw(robot, rng)
        try:
            path = Polyline(poses, blend=1e-3)
        except optik.errors.InvalidInput:
            continue
        if not planners.plan(robot, path, limits=LIMITS):  # only by its freedom
            break
    freed = planners.free(path, turn=TURN, **({"tilt": TILT} if tilted else {}))
    row: Row = {"arm": name, "tilted": tilted, "case_start": q.tolist()}
    for law in LAWS:
        begin = time.perf_counter()
        plan = planners.plan(robot, freed, limits=LIMITS, timing=law)
        row[law] = bool(plan)
        row[f"{law}_s"] = time.perf_counter() - begin
        if not plan:
            assert plan.failure is not None
            row[f"{law}_why"] = plan.failure.reason[:200]
            continue
        row[f"{law}_T"] = plan.duration if hasattr(plan, "duration") else plan.trajectory.duration
        row["sequence_s"] = plan.resolution.seconds if plan.resolution else 0.0
        row[f"{law}_off"] = check(robot, path, plan, tilted)
    return row


def check(robot: optik.Robot, path: Polyline, plan: planners.Plan, tilted: bool) -> float:
    """Return the largest distance of the tool from the given path, and how far its turn and tilt leave their ranges."""
    joints = plan.joint_path
    s = np.linspace(0.0, path.end, 400)
    given, tool = path.pose(s), robot.fk(joints(s))
    off = np.linalg.norm(given[:, :3, 3] - tool[:, :3, 3], axis=1).max()
    axis = np.einsum("ki,ki->k", given[:, :3, 2], tool[:, :3, 2])
    angle = np.arccos(np.clip(axis, -1.0, 1.0)).max()
    return float(max(off, angle - (TILT if tilted else 0.0) - 2e-5, 0.0))


def judge(rows: list[Row]) -> list[Value]:
    values = []
    for law in LAWS:
        share = np.mean([row[law] for row in rows])
        values.append(Value(f"certified, {law}", "≥ 99 %", f"{100 * share:.1f} % of {len(rows)}", share >= 0.99))
        worst = max((row[f"{law}_off"] for row in rows if row[law]), default=0.0)
        values.append(Value(f"off the given path, {law} [m, rad]", "≤ 1e-5", f"{worst:.2g}", worst <= 1e-5))
    seconds = [row["sequence_s"] for row in rows if "sequence_s" in row]
    median = float(np.median(seconds))
    values.append(Value("sequence, median [s]", "≤ 0.3", f"{median:.3f} (most {max(seconds):.2f})", median <= 0.3))
    for row in rows:
        for law in LAWS:
            if not row[law]:
                print(f"  case {row['case']}, {row['arm']}, tilted {row['tilted']}, {law}: {row[f'{law}_why']}")
    return values


if __name__ == "__main__":
    main("resolve_lines", measure, CASES, judge)
