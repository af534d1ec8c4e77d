"""Moves between two configurations, of panda with 3 kg, against Drake's KinematicTrajectoryOptimization (``benchmarks/peers``).

Both have the limits that Drake knows: velocity, acceleration, jerk and torque. Drake's motion is slowed uniformly until our
certificate proves it; ours is the shorter one if its duration is at most that.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

import optik
from benchmarks.blocks.freedom import DRAKE, solve_by_peer
from planners import JointLine, MotionLimits, PointToPoint, plan
from tests.figures.figure import Row, Value, main

SEED, COUNT = 20261127, 30


def measure(case: int) -> Row:
    """Durations of one move: along the straight joint line, ours, Drake's own and its certified one."""
    robot, rng = optik.load("panda").with_payload(3.0), np.random.default_rng([SEED, case])
    own, (low, high) = MotionLimits.of(robot), (robot.limits.lower, robot.limits.upper)
    limits = MotionLimits(own.velocity, own.acceleration, own.jerk, torque=own.torque)
    while True:
        q, goal = (low + (high - low) * rng.uniform(0.2, 0.8, robot.n) for _ in range(2))
        fixed = plan(robot, line := JointLine(robot, q, goal), q, limits=limits)
        if fixed:
            break
    path = PointToPoint(robot, q, goal)
    begin = time.process_time()
    ours = plan(robot, path, limits=limits)
    seconds = time.process_time() - begin
    other = solve_by_peer(DRAKE, limits, (robot, q, line, path), {"fixed_duration": fixed.trajectory.duration})
    return {
        "status": str(ours.status), "line": fixed.trajectory.duration, "seconds": seconds, "outcome": other["outcome"],
        "ours": ours.trajectory.duration if ours else None, "certified": other["certified"], "ms": other.get("ms"),
        "own": other.get("own_duration"), "drake": other.get("duration"),
    }  # fmt: skip


def judge(rows: list[Row]) -> Sequence[Value]:
    """How often ours is at most Drake's certified duration, and the ratios to it and to Drake's own."""
    both = [row for row in rows if row["ours"] and row["certified"]]
    least = sum(row["ours"] <= row["drake"] for row in both)
    said = f"{least} of {len(both)}; Drake has a certified motion, and we have one, of {len(both)} of {len(rows)}"
    found = [
        Value("our duration at most Drake's certified", "≥ 95 %", said, len(both) > 0 and least >= 0.95 * len(both))
    ]
    for name, what in (("drake", "certified"), ("own", "own, before it is slowed")):
        ratio = np.array([row["ours"] / row[name] for row in both])
        said = f"{np.median(ratio):.4f} ({ratio.min():.4f} to {ratio.max():.4f})"
        found.append(Value(f"our duration over Drake's {what}", "stated", said, True))
    slowed = np.array([row["drake"] / row["own"] for row in both])
    said = f"{np.median(slowed):.4f}, at most {slowed.max():.4f}; {(slowed > 1.001).sum()} by more than 0.1 %"
    found.append(Value("factor by which Drake's motion is slowed", "stated", said, True))
    said = ", ".join(
        f"{np.median([row[name] for row in both]) * scale:.2f} s" for name, scale in (("seconds", 1), ("ms", 1e-3))
    )
    return [*found, Value("time of a move, ours and Drake's (median)", "stated", said, True)]


if __name__ == "__main__":
    main("drake", measure, COUNT, judge)
