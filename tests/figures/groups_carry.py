"""Two arms carry a bar along random paths that each follows alone: relative pose, duration, CPU, contact, unequal clocks.

Oracle: both arms' own forward kinematics at 2 kHz; coal is in the tests of clearance. Cases from 100 on have seven joints.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import optik
import planners
from optik import Group, Scene, se3
from planners import Arc, Line, Path, Spline
from tests.figures.figure import Row, Value, main

BAR, GAP = 0.5, 1.5


def make_group(name: str) -> Group:
    arm = optik.load(name)
    n, most = arm.n, np.minimum(2.0, arm.limits.velocity)
    arm = arm.with_limits(velocity=most, acceleration=np.full(n, 10.0), jerk=np.full(n, 100.0))
    base = se3.pose(Rotation.from_euler("z", np.pi).as_matrix(), [GAP, 0.0, 0.0])
    grasps = [
        se3.pose(Rotation.from_euler("y", s * 90, degrees=True).as_matrix(), [-s * BAR / 2, 0, 0]) for s in (1, -1)
    ]
    left, right = (arm.with_tool(se3.inverse(grasp), add=True) for grasp in grasps)
    return Group(left=left, right=right.with_base(base))


def draw(rng: np.random.Generator) -> Path:
    def pose() -> Any:
        place = [GAP / 2 + rng.uniform(-0.08, 0.08), rng.uniform(-0.3, 0.3), rng.uniform(0.15, 0.6)]
        return se3.pose(Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3)).as_matrix(), place)

    kind = rng.integers(3)
    if kind == 0:
        return Line(pose(), pose())
    if kind == 1:
        a, b, c = pose(), pose(), pose()
        return Arc.through(a, c[:3, 3], b)
    return Spline(np.array([pose() for _ in range(4)]))


def off(one: Any, other: Any) -> tuple[float, float]:
    """The largest distance and angle between poses."""
    turned = Rotation.from_matrix(np.swapaxes(one[:, :3, :3], 1, 2) @ other[:, :3, :3]).magnitude()
    return float(np.linalg.norm(one[:, :3, 3] - other[:, :3, 3], axis=1).max()), float(turned.max())


def measure(case: int) -> Row:
    group, rng = make_group("ur5e" if case < 100 else "panda"), np.random.default_rng([case, 58])
    while True:
        path, began = draw(rng), time.process_time()
        alone = [planners.plan(robot, path) for robot in group.members.values()]
        if all(alone):
            break
    row: Row = {"alone": max(one.duration for one in alone), "alone_cpu": time.process_time() - began}
    began = time.process_time()
    found = planners.plan(group, path, tool=("left", "right"))
    row["solved"], row["cpu"] = bool(found) and found.held is not None, time.process_time() - began
    if not row["solved"]:
        return row | {"why": str(found)[:300]}
    t = np.arange(0.0, found.duration, 5e-4)
    hands, held = group.fk(found.trajectory(t)), found.held
    row |= {"T": found.duration, "held": held[:2], "seen": off(*hands.values()), "per_ms": held[4:]}
    late = group.members["right"].fk(
        group.split(found.trajectory(np.maximum(np.arange(0.0, found.duration, 1e-4) - 1e-3, 0.0)))["right"]
    )
    here = group.members["left"].fk(group.split(found.trajectory(np.arange(0.0, found.duration, 1e-4)))["left"])
    row["late"] = off(here, late)
    free = planners.plan(group, path, tool=("left", "right"), scene=Scene())
    row["free"], row["why"] = bool(free), "" if free else free.failure.reason[:200]
    return row


def judge(rows: list[Row]) -> list[Value]:
    done = [row for row in rows if row["solved"]]
    held, seen = (np.array([row[key] for row in done]) for key in ("held", "seen"))
    ratio, cpu = (np.median([row[a] / row[b] for row in done]) for a, b in (("T", "alone"), ("cpu", "alone_cpu")))
    per_ms, late = (np.array([row[key] for row in done]) for key in ("per_ms", "late"))
    free = sum(row["free"] for row in done)
    skew, least = (late / (per_ms + held)).max(), (late[:, 0] / per_ms[:, 0]).min()
    return [
        Value("solved", "all", f"{len(done)} of {len(rows)}", len(done) == len(rows)),
        Value("held [m, rad]", "1e-8", f"{held[:, 0].max():.3g}, {held[:, 1].max():.3g}", held.max() <= 1e-8),
        Value("seen over proved", "1", f"{(seen / held).max():.4f}", bool((seen <= held + 2e-15).all())),
        Value("T over the slower arm alone, median", "1.01", f"{ratio:.4f}", ratio <= 1.01),
        Value("CPU over both plans alone, median", "1.0", f"{cpu:.2f}", cpu <= 1.0),
        Value("collision-free with an empty scene", "95 % that exist", f"{free} of {len(done)}", free >= 0.95 * len(done)),
        Value("1 ms late, seen over stated", "1, 0.99", f"{skew:.5f}, {least:.4f}", skew <= 1.0 and least >= 0.99),
    ]  # fmt: skip


if __name__ == "__main__":
    main("groups_carry", measure, 150, judge)
