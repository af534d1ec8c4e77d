"""HJCD-IK's 2,000 goals for the Franka: how many `lm` solves from one cold start, and its time beside random goals.

The environment variable ``RIVALS`` names a folder with ``hjcd``, the repository A2R-Lab/HJCD-IK, which is read and never
copied: ``tests/franka_goals_dataset.yml`` holds positions and quaternions (w, x, y, z) of link 7. Of a goal without an
answer, all ranges of the joints are widened by bisection until it has one: that is how far it is outside.
"""

from __future__ import annotations

import os
import warnings
from functools import cache
from pathlib import Path
from time import perf_counter_ns

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from optik import JointLimits, Robot
from optik.ik import LM
from optik.types import Array
from tests import oracles
from tests.figures.figure import Row, Value, main

COUNT, TOLERANCE, REPEATS, SEED = 2000, 1e-6, 5, 20261129
START = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])  # a tuple takes the slower path of `solve`
WIDEST, STEPS = 0.5, 30
"""Largest widening of the ranges that is tried [rad], and steps of the bisection."""


def folder() -> Path:
    return Path(os.environ["RIVALS"]) / "hjcd"


@cache
def arm() -> Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return Robot.from_urdf(folder() / "include/test_urdf/panda.urdf", tip="panda_link7")


@cache
def goals() -> Array:
    """The goals (2000, 4, 4)."""
    read = yaml.load((folder() / "tests/franka_goals_dataset.yml").read_text(), yaml.CSafeLoader)["goals"]
    T = np.tile(np.eye(4), (len(read), 1, 1))
    T[:, :3, 3] = [goal["position"] for goal in read]
    T[:, :3, :3] = Rotation.from_quat([goal["quaternion"] for goal in read], scalar_first=True).as_matrix()
    return T


@cache
def random_goals() -> Array:
    """As many poses of random configurations."""
    return arm().fk(arm().limits.sample(np.random.default_rng(SEED), COUNT))


def solve(robot: Robot, target: Array) -> tuple[bool, float]:
    """Whether a goal is solved, by the oracle's forward kinematics, and the shortest time of some calls [µs]."""
    solver, times = LM(robot), []
    for _ in range(REPEATS):
        begin = perf_counter_ns()
        answer = solver.solve(target, START)
        times.append((perf_counter_ns() - begin) / 1e3)
    error = np.linalg.inv(target) @ oracles.fk(robot, answer.q) if answer else np.eye(4)
    right = np.linalg.norm(error[:3, 3]) <= TOLERANCE and Rotation.from_matrix(error[:3, :3]).magnitude() <= TOLERANCE
    inside = robot.limits.contains(answer.q)
    return bool(answer) and bool(right) and bool(inside), min(times)


def find_excess(target: Array) -> float:
    """The least widening of all ranges at which the goal is solved [rad]; infinite above `WIDEST`."""
    low, high, limits = 0.0, WIDEST, arm().limits

    def solved(wider: float) -> bool:
        return bool(LM(arm().with_limits(JointLimits(limits.lower - wider, limits.upper + wider))).solve(target, START))

    if not solved(high):
        return np.inf
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if solved(middle) else (middle, high)
    return high


def measure(case: int) -> Row:
    """One goal of the file, and one random goal."""
    if not case:
        solve(arm(), random_goals()[0])  # compiles
    (solved, time), (other, other_time) = solve(arm(), goals()[case]), solve(arm(), random_goals()[case])
    row: Row = {"solved": solved, "us": time, "random": other, "random_us": other_time}
    return row if solved else row | {"excess": find_excess(goals()[case])}


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    for row in rows:
        if not row["solved"]:
            print(f"    goal {row['case']}: solved where all ranges are {row['excess']:.3g} rad wider")
    solved, least = sum(row["solved"] for row in rows), 0.9955 * len(rows)
    mine, theirs = (float(np.median([row[key] for row in rows])) for key in ("us", "random_us"))
    return [
        Value("goals solved", "≥ 1,991 of 2,000", f"{solved} of {len(rows)}", solved >= least),
        Value(
            "random goals solved", "all", f"{sum(row['random'] for row in rows)}", all(row["random"] for row in rows)
        ),
        Value("median time over that of random goals", "≤ 1.0", f"{mine / theirs:.2f} ({mine:.1f} µs)", mine <= theirs),
    ]


if __name__ == "__main__":
    main("hjcd", measure, COUNT, judge)
