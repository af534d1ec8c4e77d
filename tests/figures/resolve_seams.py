"""Seams of 400 poses among boxes, swept from collision-free joint motions that are forgotten: found, certified, how fast.

The arms have one to four redundant joints: those beyond six, and the turn and the tilt of the tool. The oracle is coal at 500
samples of each motion; the duration is compared with that of the known motion, which the same law times.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

import optik
import planners
from benchmarks.blocks.seams import TOLERANCE, draw_seams
from optik.errors import NoSolution
from optik.ik import get_solver
from planners import MotionLimits, free
from planners.following.follow import make_follower
from planners.following.resolve.freedoms import FreeWay
from planners.paths.free_path import FreePath
from planners.timing.optimal import Optimal
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import COAL_ERROR, Oracle

SEED, CASES, POSES = 20261129, 500, 400
ARMS: tuple[tuple[str, dict[str, Any], int], ...] = (
    ("panda", {}, 5), ("ur5e", {"turn": 1.5}, 6), ("paper6r", {"turn": 2.0, "tilt": 0.4}, 5),
    ("panda", {"turn": 1.5, "tilt": 0.4}, 5),
)  # fmt: skip
"""Arm, freedoms beside its elbow, and boxes."""
LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)


def draw(case: int) -> Iterator[tuple[optik.Robot, optik.Scene, Any, FreeWay]]:
    """Yield arm, scene, the seam with its freedoms, and the known motion along it."""
    name, freedoms, count = ARMS[case % len(ARMS)]
    robot = optik.load(name)
    for scene, path, q, f in draw_seams(robot, np.random.default_rng([SEED, case]), count, POSES, freedoms):
        s = np.linspace(0.0, path.end, 4 * POSES)[::16]
        # the place of each pose: the polyline's own length up to it
        step = np.linalg.norm(np.diff(robot.fk(q)[:, :3, 3], axis=0), axis=1)
        at = np.append(0.0, np.cumsum(step)) * path.end / step.sum()
        known = FreeWay(s, CubicSpline(at, q)(s), CubicSpline(at, f)(s) if f.size else f[: len(s)])
        yield robot, scene, free(path, **freedoms) if freedoms else path, known


def time_known(robot: optik.Robot, path: Any, known: FreeWay) -> float:
    """Return the duration of the known motion by the law optimal; NaN if the path cannot be followed along it."""
    if isinstance(path, FreePath):
        finer = path.with_count(len(known.s) // 2)
        path = finer.with_coefficients(known.fit(finer), None)
    q = known.q[0].copy()
    found = optik.solve_ik(robot, path.pose(0.0), q)
    if not found:
        return float("nan")
    follower = make_follower(
        get_solver(robot, "lm"), path, found.q, "start", 3 * POSES, TOLERANCE, None, 0.0, known.joints
    )
    followed = follower.run()
    if not followed or followed.joint_path is None:
        return float("nan")
    try:
        return float(Optimal().run_with_analysis(followed.joint_path, LIMITS).trajectory.duration)
    except NoSolution:
        return float("nan")


def measure(case: int) -> Row:
    robot, scene, path, known = next(found for found in draw(case) if np.isfinite(time_known(found[0], *found[2:])))
    T = time_known(robot, path, known)
    row: Row = {"arm": robot.name, "which": case % len(ARMS), "known": T, "length": path.end}
    begin, cpu = time.perf_counter(), time.process_time()
    plan = planners.plan(robot, path, limits=LIMITS, scene=scene, tolerance=TOLERANCE)
    row |= {"seconds": time.perf_counter() - begin, "cpu": time.process_time() - cpu, "certified": bool(plan)}
    row["sequence"] = plan.resolution is not None and plan.resolution.stuck is None
    row["sequence_s"] = plan.resolution.seconds if plan.resolution else 0.0
    if plan:
        row["T"] = plan.trajectory.duration
        near = Oracle(robot, scene).near(plan.trajectory(np.linspace(0.0, plan.trajectory.duration, 500)), 0.05, 0.05)
        row["coal"] = float(min(near.scene.min(), near.own.min()))
    else:
        assert plan.failure is not None
        row |= {"status": str(plan.status), "why": plan.failure.reason[:300]}
    return row


def judge(rows: list[Row]) -> list[Value]:
    for row in rows:
        if not row["certified"]:
            print(f"  case {row['case']}, {row['arm']} ({row['which']}): {row['status']}: {row['why']}")
    n, values = len(rows), []
    found = sum(row["sequence"] or row["certified"] for row in rows) / n
    values.append(Value("sequence found", "≥ 99 %", f"{100 * found:.1f} % of {n}", found >= 0.99))
    certified = sum(row["certified"] for row in rows) / n
    values.append(Value("certified", "≥ 98 %", f"{100 * certified:.1f} % of {n}", certified >= 0.98))
    seconds = [row["seconds"] for row in rows]
    median = float(np.median(seconds))
    values.append(Value("all, median [s]", "≤ 3", f"{median:.2f} (most {max(seconds):.1f})", median <= 3.0))
    ratios = [row["T"] / row["known"] for row in rows if row["certified"]]
    ratio = float(np.median(ratios)) if ratios else np.inf
    spread = f"{ratio:.3f} ({min(ratios):.2f} to {max(ratios):.2f})"
    values.append(Value("duration over the known motion's, median", "≤ 1.05", spread, ratio <= 1.05))
    touched = sum(row.get("coal", 1.0) < -COAL_ERROR for row in rows)
    values.append(Value("motions in contact by coal", "0", str(touched), touched == 0))
    lost = [row for row in rows if row.get("status") in ("unreachable",) or "no branch" in row.get("why", "")]
    values.append(Value("called unreachable, or without a branch", "0", str(len(lost)), not lost))
    for k in range(len(ARMS)):
        own = [row for row in rows if row["which"] == k]
        T = [row["T"] / row["known"] for row in own if row["certified"]]
        words = (
            f"{sum(row['certified'] for row in own)} of {len(own)}, {np.median([row['seconds'] for row in own]):.2f} s"
        )
        print(f"  {ARMS[k][0]} {ARMS[k][1]}: {words}, T {np.median(T) if T else np.nan:.3f}")
    return values


if __name__ == "__main__":
    main("resolve_seams", measure, CASES, judge, part=0.2)
