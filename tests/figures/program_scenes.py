"""Programs among boxes, drawn around a known collision-free motion: how many are planned, and contacts by coal.

The known motion goes through random configurations, straight in the joints, and along short lines of the tool. Boxes are kept
where they are away from it. The program has its goals: joints by `avoid=True` or straight, and the lines, with zones of 10 mm.
"""

from __future__ import annotations

import numpy as np

import optik
import planners
from optik import Scene, se3
from optik.ik import get_solver
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners import MotionLimits, Move, Part, Program
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import COAL_ERROR, Oracle

SEED, CASES = 43, 50
ARMS = ("ur5e", "panda")
BOXES, KEPT, OWN = 12, 0.03, 0.005
"""Boxes that are tried; least distances from the known motion to them, and between the arm's links [m]."""
RATE = 1000.0
"""Samples of a motion for coal [1/s]."""


def known(robot: optik.Robot, rng: np.random.Generator) -> tuple[Array, list[Part], Array]:
    """The start, the parts of a program, and configurations (k, n) along the known motion, without contact of its own."""
    own = Scene()
    low, high = np.maximum(robot.limits.lower, -2.5), np.minimum(robot.limits.upper, 2.5)
    q = np.zeros(robot.n)
    while find_nearest_pairs(robot, own, q[None])[0][0] <= OWN or robot.fk(q)[2, 3] < 0.2:
        q = 0.5 * (low + high) + 0.3 * (high - low) * rng.uniform(-1.0, 1.0, robot.n)
    start, parts, way = q, [], [q[None]]
    count = int(rng.integers(3, 7))
    while len(parts) < count:
        if rng.random() < 0.5 or not parts:
            goal = robot.limits.clip(q + rng.uniform(-0.8, 0.8, robot.n))
            leg = q + np.linspace(0.0, 1.0, 60)[:, None] * (goal - q)
            part = Part(goal, blend=0.01, avoid=bool(rng.random() < 0.5))
        else:
            vector = rng.normal(size=3)
            vector *= rng.uniform(0.05, 0.15) / np.linalg.norm(vector)
            line = planners.Line(robot.fk(q), se3.pose(robot.fk(q)[:3, :3], robot.fk(q)[:3, 3] + vector))
            followed = planners.follow(get_solver(robot, "lm"), line, q, samples=31)
            if not followed:
                continue
            leg, part = followed.joint_path(np.linspace(0.0, line.end, 60)), Part(Move(vector, "base"), blend=0.01)
        if find_nearest_pairs(robot, own, leg)[0].min() <= OWN or robot.fk(leg)[:, 2, 3].min() < 0.1:
            continue
        parts.append(part)
        way.append(leg)
        q = leg[-1]
    parts[-1] = Part(parts[-1].goal, avoid=parts[-1].avoid)
    if not any(part.avoid for part in parts):
        parts[0] = Part(parts[0].goal, blend=parts[0].blend, avoid=True)
    return start, parts, np.concatenate(way)


def boxes(robot: optik.Robot, way: Array, rng: np.random.Generator) -> Scene:
    """Boxes that keep their distance from the known motion, near it."""
    kept: list[tuple[Array, Array]] = []
    for _ in range(BOXES):
        tool = robot.fk(way[rng.integers(len(way))])[:3, 3]
        pose = se3.pose(se3.exp_so3(rng.normal(size=3)), tool + rng.normal(size=3) * 0.25)
        box = pose, rng.uniform(0.05, 0.3, 3)
        if Oracle(robot, Scene(boxes=[box])).near(way[::3], KEPT, KEPT).scene.min() >= KEPT:
            kept.append(box)
    return Scene(boxes=kept)


def measure(case: int) -> Row:
    """Whether a program is planned, and its least distance by coal."""
    rng = np.random.default_rng([SEED, case])
    robot = optik.load(ARMS[case % len(ARMS)])
    start, parts, way = known(robot, rng)
    scene = boxes(robot, way, rng)
    limits = MotionLimits.of(robot, velocity=2.0, acceleration=10.0, jerk=100.0)
    found = planners.plan(robot, Program(parts), start, limits=limits, scene=scene)
    row: Row = {
        "boxes": len(scene.names),
        "parts": len(parts),
        "solved": bool(found),
        "avoid": sum(bool(p.avoid) for p in parts),
    }
    if not found:
        assert found.failure is not None
        return row | {"reason": found.failure.reason}
    motion = found.trajectory
    q = motion(np.linspace(0.0, motion.end, int(RATE * motion.end) + 2))
    near = Oracle(robot, scene).near(q, 0.05, 0.05)
    return row | {
        "coal": float(min(near.scene.min(), near.own.min())), "sections": len(found.sections),
        "narrower": sum("contact" in corner.reduced for corner in found.corners),
    }  # fmt: skip


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    solved = [row for row in rows if row["solved"]]
    touching = sum(row["coal"] <= -COAL_ERROR for row in solved)
    share = len(solved) / len(rows)
    reasons = "; ".join(row["reason"][:80] for row in rows if not row["solved"])
    about = f"{np.mean([row['boxes'] for row in rows]):.3g} boxes, {sum(row['avoid'] for row in rows)} parts with avoid"
    narrower = sum(row["narrower"] for row in solved)
    return [
        Value(
            f"solved ({about}; {narrower} corners narrower)", "≥ 95 %", f"{100 * share:.3g} % {reasons}", share >= 0.95
        ),
        Value("programs in contact by coal at 1 kHz", "0", str(touching), touching == 0),
    ]


if __name__ == "__main__":
    main("program_scenes", measure, CASES, judge)
