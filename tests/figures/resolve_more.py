"""Seams with torque limits, constant speed with freedoms against a direct minimax, and the memory of a seam of 1,000 poses.

Cases 0 to 49 are seams of a loaded ur5e with a free turn and of panda: the torques of each motion are computed by Pinocchio at
2 kHz. Cases 50 to 58 are lines: the duration of `constant_speed` against that along the initial path, and against the least
duration over constant turns and tilts by a plain search. Case 59 is the memory.
"""

from __future__ import annotations

import itertools
import resource
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import optik
import planners
from optik.errors import InvalidInput
from planners import Line, MotionLimits, Polyline, free
from tests.figures.figure import Row, Value, main
from tests.oracles.pinocchio import PinocchioDynamics

SEED, SEAMS, LINES, POSES, RATE = 20261202, 50, 9, 60, 2000.0
PAYLOADS = {"ur5e": 3.0, "panda": 2.0}
LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)


def draw(robot: optik.Robot, rng: np.random.Generator, turn: float, poses: int = POSES) -> Polyline:
    """Return a polyline swept by a regular joint motion, turned away inside the freedom."""
    while True:
        way = np.cumsum([0.7 * robot.limits.sample(rng, 1)[0], *rng.uniform(-0.6, 0.6, (3, robot.n))], axis=0)
        q = CubicSpline(np.linspace(0.0, 1.0, 4), way)(np.linspace(0.0, 1.0, poses))
        if not robot.limits.contains(q).all() or robot.singular_values(q)[:, -1].min() < 0.03:
            continue
        T = robot.fk(q)
        angle = 0.9 * turn * np.sin(np.linspace(0.0, 3.0, poses))
        T[:, :3, :3] = T[:, :3, :3] @ Rotation.from_euler("z", -angle[:, None]).as_matrix()
        try:
            return Polyline(T, blend=1e-3)
        except InvalidInput:
            continue


def torque_case(case: int) -> Row:
    name = ("ur5e", "panda")[case % 2]
    robot, rng = optik.load(name).with_payload(PAYLOADS[name], (0.0, 0.0, 0.05)), np.random.default_rng([SEED, case])
    turn = 1.5 if name == "ur5e" else 0.0
    path: Any = draw(robot, rng, turn)
    limits = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0, torque=robot.limits.torque)
    found = planners.plan(robot, free(path, turn=turn) if turn else path, limits=limits)
    row: Row = {"kind": "torque", "arm": name, "certified": bool(found)}
    if not found:
        assert found.failure is not None
        return row | {"why": found.failure.reason[:200]}
    t = np.arange(0.0, found.trajectory.duration, 1.0 / RATE)
    orders = [found.trajectory(t, order) for order in range(3)]
    dynamics = PinocchioDynamics(robot)
    torque = np.array([dynamics.torques(*(order[k] for order in orders)) for k in range(len(t))])
    return row | {"ratio": float((np.abs(torque) / robot.limits.torque).max())}


def speed_case(case: int) -> Row:
    rng = np.random.default_rng([SEED, case])
    robot = optik.load("paper6r")
    while True:
        q = 0.6 * robot.limits.sample(rng, 1)[0]
        start = robot.fk(q)
        goal = start.copy()
        step = rng.normal(size=3)
        goal[:3, 3] += 0.25 * step / np.linalg.norm(step)
        path = Line(start, goal)
        first = planners.plan(robot, path, q, limits=LIMITS, timing="constant_speed")
        if first:
            break
    freed = free(path, turn=1.0, tilt=0.4, hold_start=False)
    found = planners.plan(robot, freed, q, limits=LIMITS, timing="constant_speed")
    best = np.inf
    for turn, a, b in itertools.product(np.linspace(-1.0, 1.0, 9), *2 * [np.linspace(-0.28, 0.28, 5)]):
        at = free(path, turn=1.0, tilt=0.4)
        one = at.with_coefficients(np.tile([turn, a, b], (at.spline.count, 1)), None)
        try:
            made = planners.plan(robot, _frozen(one), None, limits=LIMITS, timing="constant_speed", resolve="local")
        except optik.errors.OptikError:
            continue
        best = min(best, made.trajectory.duration if made else np.inf)
    return {
        "kind": "speed", "first": first.trajectory.duration, "best": best,
        "T": found.trajectory.duration if found else np.inf,
    }  # fmt: skip


def _frozen(path: Any) -> Line:
    """Return the line along which a tool with constant coordinates moves."""
    return Line(path.pose(0.0), path.pose(path.end))


def memory_case() -> Row:
    robot, rng = optik.load("panda"), np.random.default_rng(SEED)
    path = draw(robot, rng, 0.0, 1000)
    planners.plan(robot, path, limits=LIMITS, resolve="local")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    from planners.following.resolve.freedoms import Resolver

    Resolver(robot, path, None, 60.0).find(None, held=False, many=True, count=5)
    return {"kind": "memory", "mb": (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024}


def measure(case: int) -> Row:
    if case < SEAMS:
        return torque_case(case)
    return speed_case(case) if case < SEAMS + LINES else memory_case()


def judge(rows: list[Row]) -> list[Value]:
    values = []
    torque: list[Row] = [row for row in rows if row["kind"] == "torque"]
    for row in torque:
        if not row["certified"]:
            print(f"  case {row['case']}, {row['arm']}: {row['why']}")
    worst = max((row["ratio"] for row in torque if row["certified"]), default=0.0)
    count = sum(row["certified"] for row in torque)
    values.append(
        Value("torque limits exceeded by Pinocchio", "0", f"largest ratio {worst:.6f} of {count}", worst <= 1.000001)
    )
    values.append(Value("seams with torque limits certified", "-", f"{count} of {len(torque)}", True))
    speed: list[Row] = [row for row in rows if row["kind"] == "speed"]
    if speed:
        longer = max(row["T"] / row["first"] for row in speed)
        values.append(Value("constant speed over the initial path's", "≤ 1", f"{longer:.4f}", longer <= 1.0 + 1e-9))
        over = [row["T"] / row["best"] for row in speed]
        words = f"median {np.median(over):.3f}, most {max(over):.3f}"
        values.append(Value("constant speed over the best constant coordinates", "≤ 1.05", words, max(over) <= 1.05))
    for row in (row for row in rows if row["kind"] == "memory"):
        values.append(Value("memory of 1,000 poses [MB]", "≤ 50", f"{row['mb']:.0f}", row["mb"] <= 50.0))
    return values


if __name__ == "__main__":
    main("resolve_more", measure, SEAMS + LINES + 1, judge)
