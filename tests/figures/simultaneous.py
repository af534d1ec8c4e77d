"""Path and time together against an independent formulation by CasADi and IPOPT on equal grid points, over all freedoms.

IPOPT begins at the core's initial guess. Where it ends elsewhere, it begins again at the core's solution, which must then be
an optimum of its own. The optimum counts as unique where that is not needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.peers.casadi_simultaneous import solve_jointly
from optik.arm.robot import Robot
from optik.ik import make_solver
from optik.types import Array
from planners import Line, MotionLimits, Path, PointToPoint, follow, free
from planners.choice.choose import choice_for
from planners.choice.solve import solve
from planners.timing.optimal import Optimal
from tests.figures.figure import Row, Value, main
from tests.figures.freedom import arm_of
from tests.figures.moving import span

SEED, INTERVALS = 20261125, 24
SAME = 1e-5
"""Largest relative difference of durations that count as equal."""
LIMITS = MotionLimits(2.0, 10.0, 100.0)
KINDS = {
    "turn": ("torch", {"turn": True}), "turn ur5e": ("ur5e", {"turn": True}), "tilt": ("torch", {"tilt": 0.3}),
    "tilt, turn": ("torch", {"tilt": 0.2, "turn": (-1.0, 1.0)}), "elbow": ("panda", {"elbow": True}),
    "elbow iiwa14": ("iiwa14", {"elbow": True}), "joints": ("panda", {}), "joints ur5e": ("ur5e", {}),
}  # fmt: skip
CASES = [(kind, i) for i in range(4) for kind in KINDS][:30]


def measure(case: int) -> Row:
    """Both durations and the largest difference of the coefficients, of one problem."""
    kind, i = CASES[case]
    name, freedoms = KINDS[kind]
    robot, rng = arm_of(name), np.random.default_rng([SEED, case, i])
    low, high = span(robot)
    while True:
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        path = make(robot, q, freedoms, rng)
        joints = follow(make_solver(robot, "lm"), path, q).joint_path
        if joints is None or not np.isfinite(joints.end) or joints.end < path.end:
            continue
        optimum = Optimal(intervals=INTERVALS).run_with_optimum(joints, LIMITS)[1]
        given = choice_for(path, joints, optimum, held=False)
        found = solve(given.programme, given.p, given.bounds, given.near, least=1e-9, damping=given.damping)
        if found is not None:
            break
    other = solve_jointly(given)
    first = other.duration / found.duration
    if not other.success or abs(first - 1.0) > SAME:  # another optimum: is the core's one too?
        other = solve_jointly(given, (found.z, found.p, found.path))
    return {
        "kind": kind, "success": other.success, "first": first, "ratio": other.duration / found.duration,
        "off": float(np.abs(found.p - other.p).max()), "steps": found.steps, "iterations": other.iterations,
    }  # fmt: skip


def make(robot: Robot, q: Array, freedoms: dict[str, Any], rng: np.random.Generator) -> Path:
    """A random line with freedoms, or a random move."""
    if not freedoms:
        return PointToPoint(robot, q, q + rng.uniform(-0.6, 0.6, robot.n))
    T, way = robot.fk(q), rng.normal(size=3)
    goal = T.copy()
    goal[:3, 3] += 0.2 * way / np.linalg.norm(way)
    return free(Line(T, goal), **freedoms)


def judge(rows: list[Row]) -> Sequence[Value]:
    """Largest differences, and how often IPOPT finds another optimum from the core's initial guess."""
    worst = max(abs(row["ratio"] - 1.0) for row in rows)
    unique = [row for row in rows if abs(row["first"] - 1.0) <= SAME and "joints" not in row["kind"]]
    others = [f"{row['kind']} {row['first']:.4f}" for row in rows if not abs(row["first"] - 1.0) <= SAME]
    said = f"{worst:.1e} on {len(rows)}; from the core's guess IPOPT ends elsewhere: {', '.join(others) or 'never'}"
    off = max(row["off"] for row in unique)
    return [
        Value("difference of T, relative", "≤ 1e-5", said, worst <= SAME and all(row["success"] for row in rows)),
        Value(
            "difference of the coefficients, optimum unique", "≤ 1e-3 rad", f"{off:.1e} on {len(unique)}", off <= 1e-3
        ),
    ]


if __name__ == "__main__":
    main("simultaneous", measure, len(CASES), judge)
