"""Seams of 400 poses with a turning tool, feasible by construction: followed at least as often as proved, at two tolerances.

A joint spline through four random configurations gives the poses; the tool is turned about its axis by up to 1.35 rad along the
way, and the seam is planned without that freedom. A seam that is followed and not proved counts against the figure.
"""

from __future__ import annotations

import time

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

import optik
from optik.errors import OptikError
from planners import MotionLimits, PlanStatus, Polyline, plan
from tests.figures.figure import Row, Value, main

COUNT, POSES, TURN = 24, 400, 1.5
LIMITS = MotionLimits(2.0, 10.0, 100.0)
FOLLOWED = (PlanStatus.SOLVED, PlanStatus.NOT_PROVED, PlanStatus.LIMITS_EXCEEDED)


def draw(seed: int) -> tuple[Polyline, np.ndarray]:
    """The seam and a configuration at its start."""
    robot, rng = optik.load("ur5e"), np.random.default_rng([seed, 37])
    while True:
        q = robot.limits.sample(rng, 400) * 0.9 + 0.1 * robot.limits.middle
        way = [q[0]]
        for _ in range(3):
            off = np.linalg.norm(q - way[-1], axis=1)
            near = q[(off > 0.8) & (off < 2.5)]
            if len(near):
                way.append(near[rng.integers(len(near))])
        if len(way) < 4:
            continue
        u = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
        x = scipy.interpolate.CubicSpline(u, way, bc_type="natural")(np.linspace(0.0, u[-1], POSES))
        if robot.limits.contains(x).all() and robot.singular_values(x)[:, -1].min() >= 0.02:
            break
    poses = robot.fk(x)
    w = rng.uniform(1.0, 3.0) * np.linspace(0.0, 2.0 * np.pi, POSES) + rng.uniform(0.0, 6.0)
    turn = Rotation.from_rotvec(np.outer(0.9 * TURN * np.sin(w), [0.0, 0.0, 1.0])).as_matrix()
    poses[:, :3, :3] = poses[:, :3, :3] @ np.swapaxes(turn, 1, 2)
    return Polyline(poses, blend=1e-3), x[0]


def measure(case: int) -> Row:
    """One seam at both tolerances."""
    path, _ = draw(case)
    row: Row = {"length": path.end}
    for tolerance in (1e-5, 1e-4):
        begin = time.process_time()
        try:
            made = plan(optik.load("ur5e"), path, limits=LIMITS, tolerance=(tolerance, tolerance))
        except OptikError as error:
            row[f"{tolerance:g}"] = {"status": "refused", "reason": str(error)}
            continue
        reason = "" if made else made.failure.reason
        row[f"{tolerance:g}"] = {"status": str(made.status), "reason": reason, "cpu": time.process_time() - begin}
    return row


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    values, followed = [], {}
    for tolerance in ("1e-05", "0.0001"):
        some = [row[tolerance] for row in rows]
        followed[tolerance] = {row["case"] for row in rows if row[tolerance]["status"] in FOLLOWED}
        proved = {row["case"] for row in rows if row[tolerance]["status"] == PlanStatus.SOLVED}
        cpu = np.median([x["cpu"] for x in some if "cpu" in x])
        words = f"{len(proved)} of {len(followed[tolerance])} followed, median {cpu:.2f} s"
        values.append(Value(f"{tolerance}: proved", "all that are followed", words, proved == followed[tolerance]))
        for row in rows:
            if row[tolerance]["status"] != PlanStatus.SOLVED:
                print(
                    f"    {tolerance}, case {row['case']}: {row[tolerance]['status']}: {row[tolerance]['reason'][:150]}"
                )
    lost = followed["1e-05"] - followed["0.0001"]
    values.append(Value("refused only with the wider tolerance", "0", f"{len(lost)}", not lost))
    return values


if __name__ == "__main__":
    main("seams", measure, COUNT, judge)
