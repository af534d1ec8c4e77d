"""Derivatives of limited values, and of the least barrier objective, in a path's coefficients, against central differences.

The oracle of the rows moves each coefficient by ±1e-6; that of the gradient solves the barrier problem anew at ±1e-5 along
random directions. The barrier's objective is smooth, so no active set changes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import optik
from optik.types import Array
from planners import Line, MotionLimits, PointToPoint, free, plan
from planners.choice.choose import Choice, JointChoice
from planners.choice.solve import _Iteration
from planners.timing.interior_point import iteration
from planners.timing.optimal import Optimal
from tests.figures.figure import Row, Value, main
from tests.figures.moving import span
from tests.planners.test_freedom import choice, limited_values

SEED = 20261124
FREEDOMS = {
    "turn": {"turn": True}, "tilt": {"tilt": 0.3}, "tilt, turn": {"tilt": 0.3, "turn": (-1.0, 1.0)}, "elbow": {"elbow": True},
    "all": {"tilt": 0.3, "turn": True, "elbow": True}, "joints": {},
}  # fmt: skip
LIMITS = ("v, a, j", "v, j, torque", "all")
CASES = [(f, limits, i) for f in FREEDOMS for limits in LIMITS for i in range(5)]


def limits_of(robot: optik.Robot, name: str) -> MotionLimits:
    """Limits of a kind."""
    own = MotionLimits.of(robot)
    if name == "v, a, j":
        return MotionLimits(2.0, 10.0, 100.0)
    if name == "all":
        return MotionLimits(
            own.velocity, own.acceleration, own.jerk, torque=own.torque, torque_rate=own.torque_rate, tool_speed=0.5,
            rotation_speed=1.0,
        )  # fmt: skip
    return MotionLimits(own.velocity, None, own.jerk, torque=own.torque)


def make(freedom: str, name: str, rng: np.random.Generator) -> Choice:
    """The choice on a random line, or a random move, of panda with 2 kg."""
    robot = optik.load("panda").with_payload(2.0)
    limits, (low, high) = limits_of(robot, name), span(robot)
    while True:
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        if freedom == "joints":
            path = PointToPoint(robot, q, low + (high - low) * rng.uniform(0.3, 0.7, robot.n))
            found = plan(robot, path, limits=limits)
            if found:
                optimum = Optimal().run_with_optimum(found.joint_path, limits)[1]
                return JointChoice(path, found.joint_path, optimum)
            continue
        T, way = robot.fk(q), rng.normal(size=3)
        goal = T.copy()
        goal[:3, 3] += 0.2 * way / np.linalg.norm(way)
        if plan(robot, Line(T, goal), q, limits=limits):
            return choice(robot, free(Line(T, goal), **FREEDOMS[freedom]), q, limits)


def columns_error(given: Choice, rng: np.random.Generator) -> float:
    """Largest error of the columns, relative to the largest entry of each row's kind."""
    programme, z, h = given.programme, given.optimum.programme.start, 1e-6
    moved = 0.01 * rng.normal(size=given.p.shape) * programme.window.free.reshape(given.p.shape)
    p = given.bounds.clip(given.p + moved)
    place = programme.place(p, given.near)
    assert place is not None
    border, worst = programme.make_border(), 0.0
    programme.fill(place, z, np.zeros_like(limited_values(given, p, place.path, z)), border)
    free_ones = np.flatnonzero(programme.window.free)
    for i in rng.choice(free_ones, min(10, free_ones.size), replace=False):
        step = np.zeros(p.size)
        step[i] = h
        ahead, behind = (limited_values(given, p + sign * step.reshape(p.shape), place.path, z) for sign in (1.0, -1.0))
        change, column = (ahead - behind) / (2.0 * h), np.zeros_like(ahead)
        for k in range(programme.K + 1):
            at, rows = i - programme.begin[k], slice(None if k < programme.K else programme.rows)
            if 0 <= at < programme.width:
                column[k, rows] = border.columns[k, rows, at]
        size = np.maximum(np.abs(change).max(axis=0), 1e-2)
        worst = max(worst, float((np.abs(column - change) / size).max()))
    return worst


def gradient_error(given: Choice, rng: np.random.Generator) -> float:
    """Largest error of the slope of the barrier's least objective along two random directions, relative to the gradient."""

    def barrier(p: Array) -> tuple[float, Array]:
        programme, place = given.programme, given.programme.place(p, given.near)
        assert place is not None
        one = _Iteration(programme, p, given.bounds, place, 1.0, 1e12)
        for _ in range(100):
            if not one._newton() or one._search() is None:
                return np.nan, p
            one.count = 0
        at = one.at
        value = iteration.merit(one.problem, one.mu, at.z, at.g, at.c, at.slack, one.border)
        y = at.dual[:, 0] - at.dual[:, 1]
        programme.fill(one.place, at.z, y, one.border)
        return (value[0] if value[1] < 1e-8 else np.nan), programme.gather(y, one.border)

    slope, free_ones = barrier(given.p)[1], given.programme.window.free
    worst = 0.0
    for _ in range(2):
        way = rng.normal(size=slope.size) * free_ones
        step = 1e-5 * (way / np.linalg.norm(way)).reshape(given.p.shape)
        found = (barrier(given.p + step)[0] - barrier(given.p - step)[0]) / 2e-5
        worst = max(worst, abs(float(slope @ step.ravel()) / 1e-5 - found) / float(np.linalg.norm(slope[free_ones])))
    return worst


def measure(case: int) -> Row:
    """Both errors of one case."""
    freedom, name, i = CASES[case]
    rng = np.random.default_rng([SEED, case, i])
    given = make(freedom, name, rng)
    return {
        "freedom": freedom,
        "limits": name,
        "rows": columns_error(given, rng),
        "gradient": gradient_error(given, rng),
    }


def judge(rows: list[Row]) -> Sequence[Value]:
    """The largest errors."""
    found = []
    for what in ("rows", "gradient"):
        values = np.array([row[what] for row in rows])
        said = f"{np.nanmax(values):.1e}, median {np.nanmedian(values):.1e}, of {np.isfinite(values).sum()}"
        reached = bool(np.nanmax(values) <= 1e-4 and np.isfinite(values).mean() >= 0.9)
        found.append(Value(f"error of the {what}, relative", "≤ 1e-4", said, reached))
    return found


if __name__ == "__main__":
    main("gradient", measure, len(CASES), judge)
