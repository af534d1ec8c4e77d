"""Seams between two arms, chains of 12 joints: all solved, how long they take, and how much computing.

A case draws a line, a circle or a wave on a piece that one arm holds; another one carries the torch. The oracle of the path is
the forward kinematics of both arms. The durations are compared with a bound: no motion along the joint path is faster than the
velocities of its joints allow, and a move of this size from rest to rest takes `RAMPS` by the limits on acceleration and jerk.
"""

from __future__ import annotations

import time
import warnings

import numpy as np

import planners
from optik import se3
from planners import MotionLimits
from tests.figures.figure import Row, Value, main
from tests.planners.chains import VELOCITY, draw_seam, mounted, two_arms

SEED, CASES, SIZE, STATIONS = 7, 60, 0.6, 400
ARMS = ("ur5e", "ur5e", "ur10e")
RAMPS, SLOWER = 0.3, 3.0
"""Time [s] for starting and stopping, and the greatest ratio of a duration to the bound."""


def measure(case: int) -> Row:
    warnings.simplefilter("ignore")
    name = ARMS[case % len(ARMS)]
    size, chain = SIZE if name == "ur5e" else 1.5 * SIZE, two_arms(name, gap=0.8 if name == "ur5e" else 1.2)
    limits, path = MotionLimits.of(chain), draw_seam(np.random.default_rng([SEED, case]), size)
    if case < len(ARMS):
        planners.plan(chain, path, limits=limits)  # compiles
    begin = time.process_time()
    found = planners.plan(chain, path, limits=limits)
    row: Row = {"arm": name, "path": path.name, "cpu": time.process_time() - begin, "solved": bool(found)}
    if not found:
        assert found.failure is not None
        return row | {"why": found.failure.reason[:200]}
    s = np.linspace(0.0, path.end, STATIONS)
    q, speed = found.joint_path(s), np.abs(found.joint_path(s, 1)).max(axis=1)
    holds, carries = mounted(name, 0.8 if name == "ur5e" else 1.2)
    poses = se3.inverse(holds.fk(-q[:, : holds.n][:, ::-1])) @ carries.fk(q[:, holds.n :])
    row |= {"off": float(np.abs(se3.error(poses, path.pose(s))).max()), "duration": found.duration}
    least = float(np.trapezoid(speed, s)) / VELOCITY + RAMPS
    stuck = found.resolution is not None and found.resolution.stuck is not None
    return row | {"over": found.duration / least, "stuck": stuck, "slowness": found.slowness or ""}


def judge(rows: list[Row]) -> list[Value]:
    solved = [row for row in rows if row["solved"]]
    over, cpu = [row["over"] for row in solved], [row["cpu"] for row in rows]
    for row in rows:
        if not row["solved"]:
            print(f"  case {row['case']}, {row['arm']}, {row['path']}: {row['why']}")
    off, stuck = max(row["off"] for row in solved), sum(row["stuck"] for row in solved)
    return [
        Value("solved", "all", f"{len(solved)} of {len(rows)} ({stuck} where the search is stuck)", len(solved) == len(rows)),
        Value("duration over the bound by velocities, with ramps", f"≤ {SLOWER}",
              f"{max(over):.2f} (median {np.median(over):.2f})", max(over) <= SLOWER),
        Value("off the seam by both arms' forward kinematics [m, rad]", "≤ 1e-5", f"{off:.2g}", off <= 1e-5),
        Value("CPU of a plan, warm, greatest [s]", "≤ 10", f"{max(cpu):.2f} (median {np.median(cpu):.2f})", max(cpu) <= 10.0),
    ]  # fmt: skip


if __name__ == "__main__":
    main("chains", measure, CASES, judge)
