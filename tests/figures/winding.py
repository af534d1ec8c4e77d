"""Seams whose given yaw winds by 100° to 500°, the turn free by as much: travel and duration against 16 constant yaws.

A case draws a wavy seam in reach of an arm with a straight or bent torch, which winds evenly about its axis. The oracles are
plans along the given path and along the same seam with each of 16 constant yaws, without any freedom. Travel is Σ∫|q̇| dt.
"""

from __future__ import annotations

import time
import warnings

import numpy as np

import optik
import planners
from optik import se3
from optik.types import Array
from planners import MotionLimits, Polyline
from tests.figures.figure import Row, Value, main

SEED, CASES, POSES, YAWS, SAMPLES = 20261128, 60, 40, 16, 2000
ARMS = ("irb120", "ur5e", "kr6", "panda", "iiwa14")
LIMITS = {"acceleration": 5.0, "jerk": 50.0}
LONGER, MORE = 1.002, 1.1
DOWN = np.diag([1.0, -1.0, -1.0])
LAWS = {"optimal": 0.05, "constant_speed": 0.02}
"""Limit on the tool's speed with the law optimal, and the speed of the other one [m/s]."""


def draw(case: int) -> tuple[optik.Robot, Array, float]:
    """Return an arm, points (k, 3) of a seam in its reach, and the winding of the given yaw [rad]."""
    rng, robot = np.random.default_rng([SEED, case]), optik.load(ARMS[case % len(ARMS)])
    if rng.random() < 0.5:
        bent = se3.exp_so3([0.0, np.deg2rad(rng.uniform(15.0, 45.0)), 0.0])
        robot = robot.with_tool(se3.pose(bent, [0.03, 0.0, 0.1]), add=True)
    size = 0.35 if robot.name == "irb120" else 0.5
    u = np.linspace(0.0, 1.0, POSES)
    begin = np.array([size * rng.uniform(0.9, 1.2), 0.0, size * rng.uniform(0.4, 0.9)])
    along, wave = rng.uniform(0.15, 0.3) * np.array([0.0, 1.0, 0.0]), rng.uniform(0.0, 0.03)
    points = begin + np.outer(u - 0.5, along)
    points[:, 0] += wave * np.sin(2.0 * np.pi * rng.integers(1, 3) * u)
    return robot, points, float(np.deg2rad(rng.uniform(100.0, 500.0)) * rng.choice((-1.0, 1.0)))


def seam(points: Array, yaw: Array) -> Polyline:
    R = se3.exp_so3(np.stack([np.zeros(POSES), np.zeros(POSES), yaw], axis=1)) @ DOWN
    return Polyline([se3.pose(one, p) for one, p in zip(R, points, strict=True)], blend=2e-3, blend_rotation=0.1)


def travel(plan: planners.Plan) -> float:
    return float(np.abs(np.diff(plan.trajectory(np.linspace(0.0, plan.duration, SAMPLES)), axis=0)).sum())


def measure(case: int) -> Row:
    warnings.simplefilter("ignore")
    robot, points, winding = draw(case)
    law = list(LAWS)[case // len(ARMS) % len(LAWS)]
    timing = planners.make_law(law, **({} if law == "optimal" else {"speed": LAWS[law]}))
    limits = MotionLimits.of(robot, **LIMITS, **({"tool_speed": LAWS[law]} if law == "optimal" else {}))
    given = seam(points, winding * (np.linspace(0.0, 1.0, POSES) - 0.5))
    row: Row = {"arm": robot.name, "law": law, "winding_deg": np.rad2deg(winding)}
    begin = time.process_time()
    found = planners.plan(robot, planners.free(given, turn=abs(winding)), limits=limits, timing=timing)
    row |= {"cpu": time.process_time() - begin, "solved": bool(found)}
    if found:
        assert found.freedom is not None
        row |= {"duration": found.duration, "travel": travel(found), "outcome": found.freedom.outcome}
    yaws = [np.full(POSES, yaw) for yaw in 2.0 * np.pi * np.arange(YAWS) / YAWS]
    plans = [
        planners.plan(robot, path, limits=limits, timing=timing) for path in (given, *(seam(points, y) for y in yaws))
    ]
    row["others"] = [(plan.duration, travel(plan)) if plan else None for plan in plans]
    return row


def judge(rows: list[Row]) -> list[Value]:
    longer, more, lost = list[float](), list[float](), 0
    for row in rows:
        others = [one for one in row["others"] if one]
        if not row["solved"]:
            lost += bool(others)
            continue
        shortest = min([row["duration"], *(duration for duration, _ in others)])
        near = [
            length for one in row["others"][1:] if one for duration, length in [one] if duration <= LONGER * shortest
        ]
        longer.append(row["duration"] / shortest)
        more.append(row["travel"] / min(near) if near else 0.0)
        if longer[-1] > LONGER or more[-1] > MORE:
            print(f"  case {row['case']}, {row['arm']}, {row['law']}: {longer[-1]:.4f}, {more[-1]:.3f}")
    compared = [x for x in more if x]
    seconds = float(np.median([row["cpu"] for row in rows]))
    return [
        Value("seams lost that a plan without the freedom solves", "0", f"{lost} of {len(rows)}", lost == 0),
        Value("duration over the shortest", f"≤ {LONGER}", f"{max(longer):.5f}", max(longer) <= LONGER),
        Value("travel over the least of constant yaws that are as fast", f"≤ {MORE}",
              f"{max(compared):.3f} (median {np.median(compared):.3f}, {len(compared)} seams)", max(compared) <= MORE),
        Value("CPU of a plan, median [s]", "stated", f"{seconds:.2f}", True),
    ]  # fmt: skip


if __name__ == "__main__":
    main("winding", measure, CASES, judge)
