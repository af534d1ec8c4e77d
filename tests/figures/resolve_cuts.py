"""Seams that need reconfigurations: the fewest are found, every part is certified, and the moves between are collision-free.

A seam is swept by joint motions in different configurations, one after the other. The oracle for arms with six joints is
greedy: from every configuration of the present place the branch is followed that goes farthest, and there it begins anew.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

import optik
import planners
from optik.errors import InvalidInput
from optik.ik import get_solver
from optik.types import Array
from planners import MotionLimits, Polyline, ProgramPlan, follow
from planners.following.track import find_regular_roots
from planners.paths.stretch import Stretch
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import COAL_ERROR, Oracle

SEED, CASES, POSES = 20261201, 50, 25
ARMS = ("paper6r", "ur5e", "kr6", "irb120")
LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
BACK = 1e-4
"""Fraction of the path before the end of a branch at which the oracle begins anew."""
MOST = 6


def sweep(robot: optik.Robot, q: Array, rng: np.random.Generator) -> Array | None:
    """Return a regular joint motion (POSES, n) from a configuration inside the limits."""
    for _ in range(40):
        way = np.cumsum([q, *rng.uniform(-0.5, 0.5, (2, robot.n))], axis=0)
        x = CubicSpline((0.0, 0.5, 1.0), way)(np.linspace(0.0, 1.0, POSES))
        if robot.limits.contains(x).all() and robot.singular_values(x)[:, -1].min() > 0.03:
            return np.asarray(x)
    return None


def draw(robot: optik.Robot, rng: np.random.Generator, parts: int) -> Polyline | None:
    q = robot.limits.sample(rng, 1)[0] * 0.8 + 0.2 * robot.limits.middle
    poses: list[Array] = []
    for _ in range(parts):
        x = sweep(robot, q, rng)
        if x is None:
            return None
        poses += list(robot.fk(x)[bool(poses) :])
        roots, _ = find_regular_roots(robot, poses[-1], 0.03)
        other = [r for r in roots if np.abs(np.sin(0.5 * (r - x[-1]))).max() > 0.3]
        if not other:
            return None
        q = other[int(rng.integers(len(other)))]
    try:
        return Polyline(np.array(poses), blend=1e-3)
    except InvalidInput:
        return None


def count_cuts(robot: optik.Robot, path: Any) -> int:
    """Return the fewest reconfigurations, by following every branch from the place where the farthest one before it ends."""
    s, cuts, solver = 0.0, 0, get_solver(robot, "lm")
    while cuts <= MOST:
        rest = path if s == 0.0 else Stretch(path, s, path.end)
        followed = follow(solver, rest, branch="best")
        if followed:
            return cuts
        assert followed.failure is not None
        if not followed.failure.s > 2.0 * BACK * path.end:
            return MOST + 1
        s += followed.failure.s - BACK * path.end
        cuts += 1
    return cuts


def measure(case: int) -> Row:
    robot, rng = optik.load(ARMS[case % len(ARMS)]), np.random.default_rng([SEED, case])
    while True:
        path = draw(robot, rng, 2 + case // len(ARMS) % 2)
        asked = 0 if path is None else count_cuts(robot, path)
        if path is not None and 1 <= asked <= 2:
            break
    row: Row = {"arm": robot.name, "asked": asked}
    refused = planners.plan(robot, path, limits=LIMITS)
    row["advised"] = refused.failure is not None and f"reconfigurations={asked}:" in refused.failure.advice
    begin = time.perf_counter()
    found = planners.plan(robot, path, limits=LIMITS, reconfigurations=MOST)
    row |= {"seconds": time.perf_counter() - begin, "certified": bool(found)}
    row["found"] = len(found.resolution.cuts) if found.resolution else -1
    row["program"] = isinstance(found, ProgramPlan)
    if not found:
        assert found.failure is not None
        row["why"] = found.failure.reason[:300]
    shaped = robot.shapes is not None
    inside = shaped and planners.plan(robot, path, limits=LIMITS, reconfigurations=MOST, scene=optik.Scene())
    row["in_scene"] = bool(inside)
    if inside:
        near = Oracle(robot, optik.Scene()).near(
            inside.trajectory(np.linspace(0.0, inside.trajectory.duration, 1000)), 0.05, 0.05
        )
        row["coal"] = float(near.own.min())
    return row


def judge(rows: list[Row]) -> list[Value]:
    n = len(rows)
    for row in rows:
        if not row["certified"] or row["found"] != row["asked"]:
            print(f"  case {row['case']}, {row['arm']}: {row['found']} of {row['asked']}; {row.get('why', '')}")
    fewest = sum(row["found"] <= row["asked"] for row in rows) / n
    certified = sum(row["certified"] and row["program"] for row in rows) / n
    touching = sum(row.get("coal", 1.0) < -COAL_ERROR for row in rows)
    seconds = float(np.median([row["seconds"] for row in rows]))
    inside = sum(row["in_scene"] for row in rows)
    advised = sum(row["advised"] for row in rows)
    return [
        Value("fewest reconfigurations", "≥ 95 %", f"{100 * fewest:.0f} % of {n}", fewest >= 0.95),
        Value("certified", "all", f"{100 * certified:.0f} %", certified == 1.0),
        Value("in contact by coal, of those planned with the links", "0", f"{touching} of {inside}", touching == 0),
        Value("refusals that name the number", "all", f"{advised} of {n}", advised == n),
        Value("median [s]", "-", f"{seconds:.2f}", True),
    ]


if __name__ == "__main__":
    main("resolve_cuts", measure, CASES, judge)
