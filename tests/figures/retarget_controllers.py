"""Streams through models of controllers: set-points changed by the Franka limiter, and motions after servoj.

Cases 0 to 99 are streams of panda within the limiter's limits, of 10 s at 1 kHz. Cases 100 to 199 are streams of ur5e of 5 s at
500 Hz within 0.9 of the velocity and 0.8 of the acceleration and the jerk; they are certified after `ServoJ` with its defaults.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import optik
import planners
from planners import MotionLimits, stream
from planners.retarget.controllers import FrankaLimiter, ServoJ
from tests.figures.figure import Row, Value, main
from tests.planners.test_controllers import REST, Swings

SEED, STREAMS, CHANGED = 20261127, 100, 1e-10
UR_START = np.array([0.0, -1.2, 1.4, -0.2, 0.5, 0.0])
UR_LIMITS = MotionLimits(velocity=np.pi, acceleration=10.0)
SLOWER = MotionLimits(velocity=0.9 * np.pi, acceleration=8.0, jerk=80.0)


def measure(case: int) -> Row:
    franka, rng = case < STREAMS, np.random.default_rng([SEED, case])
    robot, start = (optik.load("panda"), REST) if franka else (optik.load("ur5e"), UR_START)
    limits, rate, seconds = (FrankaLimiter.limits, 1000.0, 10.0) if franka else (SLOWER, 500.0, 5.0)
    source = Swings(rng, start, 0.5, seconds)
    flow = stream(robot, source, start, limits=limits, rate=rate, realtime=False, silence=0.5)
    q = np.array([now.q for now in flow])
    row: Row = {"kind": "limiter" if franka else "follower", "points": len(q), "kept": sum(flow.report().kept.values())}
    if franka:
        off: Any = np.abs(FrankaLimiter().apply(q) - q)
        return row | {"changed": int((off.max(axis=1) > CHANGED).sum()), "most": float(off.max())}
    proof = planners.certify(robot, None, ServoJ().follow(q), UR_LIMITS, enforced=("velocity", "acceleration"))
    return row | {"certified": proof.is_valid, "why": "; ".join(proof.reasons)}


def judge(rows: list[Row]) -> list[Value]:
    limiter = [row for row in rows if row["kind"] == "limiter"]
    follower = [row for row in rows if row["kind"] == "follower"]
    values = []
    if limiter:
        points, changed = (sum(row[key] for row in limiter) for key in ("points", "changed"))
        most = max(row["most"] for row in limiter)
        words = f"{changed} of {points:,}, at most {most:.1e} rad"
        values.append(Value("set-points changed by the limiter", "0 of 1,000,000", words, changed == 0))
    for row in follower:
        if not row["certified"]:
            print(f"  case {row['case']}: {row['why']}")
    if follower:
        count = sum(row["certified"] for row in follower)
        words = f"{count} of {len(follower)}"
        values.append(
            Value("streams certified after the follower", "≥ 95 of 100", words, count >= 0.95 * len(follower))
        )
    return values


if __name__ == "__main__":
    main("retarget_controllers", measure, 2 * STREAMS, judge)
