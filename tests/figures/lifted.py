"""Programs that take an object from one surface and put it onto another: how many are planned, and contacts by coal.

Each program is also tried with the hand driven 1 to 30 mm into the first surface, and without a payload, where limits on goods
apply in every section. Coal judges the arm of each section, whose payload alone may touch the surfaces.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import optik
import planners
from optik import Scene, se3
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners import MotionLimits, Part, Program
from planners.planning import PlanStatus
from planners.program import Dwell, Move, ToolChange
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import COAL_ERROR, Oracle

SEED, CASES = 54, 60
ARMS = {"panda_hand": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], "ur5e": [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]}
"""Arms, and where they start [rad]."""
RATE = 1000.0
"""Samples of a motion for coal [1/s]."""
OWN = 0.005
"""Least distance of the arm from itself and from the surfaces where it takes and puts the object [m]."""
PAIRS = (("payload", "from"), ("payload", "onto"))


def down(place: Array, height: float, turn: float) -> Array:
    """A pose of the tool over a place, which points down."""
    R = se3.exp_so3([0.0, 0.0, turn]) @ np.diag([1.0, -1.0, -1.0])
    return se3.pose(R, [*place[:2], place[2] + height])


def surfaces(robot: optik.Robot, start: Array, rng: np.random.Generator) -> tuple[Scene, list[Array], float, float]:
    """Two surfaces, a place on each, the height of the tool over them where it holds the object, and the way up."""
    while True:
        tall, up = rng.uniform(0.05, 0.2), rng.uniform(0.05, 0.15)
        angles = rng.uniform(-1.2, 1.2) + np.array([0.0, rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.2)])
        places = [
            np.array([*(rng.uniform(0.4, 0.6) * np.array([np.cos(a), np.sin(a)])), rng.uniform(0.0, 0.25)])
            for a in angles
        ]
        boxes = [(se3.pose(p=p - [0.0, 0.0, 0.03]), (*rng.uniform(0.15, 0.3, 2), 0.06)) for p in places]
        scene = Scene(boxes=boxes, names=("from", "onto"), allow=PAIRS)
        plain, ends = replace(scene, allow=()), [down(p, h, 0.0) for p in places for h in (tall, tall + up)]
        found = [optik.solve_ik(robot, T, start) for T in ends]
        if all(found) and find_nearest_pairs(robot, plain, np.array([start, *(f.q for f in found)]))[0].min() > OWN:
            return scene, places, tall, up


def cycle(
    places: list[Array], heights: tuple[float, float], up: float, change: list[ToolChange], home: Array
) -> Program:
    """Take, carry and put down; without a payload if there is no change."""
    take, put = change or (None, None)
    items: list[Any] = [
        Part(down(places[0], heights[0] + up, 0.0), avoid=True), Part(down(places[0], heights[0], 0.0)), Dwell(0.1), take,
        Part(Move([0.0, 0.0, up], "base")), Part(down(places[1], heights[1] + up, 0.0), avoid=True),
        Part(down(places[1], heights[1], 0.0)), Dwell(0.1), put, Part(Move([0.0, 0.0, up], "base")), Part(home, avoid=True),
    ]  # fmt: skip
    return Program([item for item in items if item is not None])


def measure(case: int) -> Row:
    """Whether the program is planned, its least distance by coal, and the two that are driven wrongly or carry nothing."""
    rng = np.random.default_rng([SEED, case])
    name, home = list(ARMS.items())[case % len(ARMS)]
    robot, start = optik.load(name), np.array(home)
    scene, places, tall, up = surfaces(robot, start, rng)
    wide, mass = rng.uniform(0.01, 0.03), rng.uniform(0.2, 1.0)
    can = ((0.0, 0.0, min(wide, 0.5 * tall)), (0.0, 0.0, tall - wide), wide)  # it stands on the surface
    change = [ToolChange(payload=mass, shapes=[can]), ToolChange(payload=None)]
    cup = planners.limits.Suction(0.8, 60.0)
    limits = MotionLimits.of(robot, velocity=1.5, acceleration=8.0, jerk=100.0, suction=cup)
    found = planners.plan(robot, cycle(places, (tall, tall), up, change, start), start, limits=limits, scene=scene)
    row: Row = {"arm": name, "solved": bool(found)}
    if found:
        row["coal"] = min(contact(section, scene) for section in found.sections)
        row["exempt"] = [i in found.certificate.exempt["suction"] for i in range(len(found.sections))]
        row["carries"] = [section.robot.payload is not None for section in found.sections]
    else:
        row["reason"] = found.failure.reason
    depth = 1e-3 * float(rng.uniform(1.0, 30.0))
    q = optik.solve_ik(robot, down(places[0], tall, 0.0), start).q
    over = Oracle(robot, replace(scene, allow=())).near(q[None], 1.0, 0.0).scene[0]
    deep = cycle(places, (tall - over - depth, tall), up, change, start)
    refused = planners.plan(robot, deep, start, limits=limits, scene=scene)
    row |= {"depth": depth, "refused": refused.status is PlanStatus.CONTACT and refused.failure.part == 1}
    further = {
        "suction": planners.limits.Suction(0.8, 60.0, mass=1.0),
        "open_container": planners.limits.OpenContainer(1.2, axis="-z"),
    }
    bare = replace(limits, extra=further)
    empty = planners.plan(
        robot, cycle(places, (tall, tall), up, [], start), start, limits=bare, scene=replace(scene, allow=())
    )
    limited = [section.certificate.extreme(kind).ratio > 0.0 for section in empty.sections for kind in further]
    return row | {
        "empty": bool(empty),
        "limited": bool(limited) and all(limited) and not (empty and empty.certificate.exempt),
    }


def contact(section: planners.Plan, scene: Scene) -> float:
    """The least distance of a section by coal [m], without the payload from the surfaces that it may touch."""
    carries = section.robot.payload is not None
    oracle, motion = Oracle(section.robot, replace(scene, allow=PAIRS if carries else ())), section.trajectory
    near = oracle.near(motion(np.linspace(0.0, motion.end, int(RATE * motion.end) + 2)), 0.05, 0.05)
    return float(min(near.scene.min(), near.own.min()))


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    solved, n = [row for row in rows if row["solved"]], len(rows)
    reasons = "; ".join(f"{row['arm']}: {row['reason'][:90]}" for row in rows if not row["solved"])
    touching, refused = sum(row["coal"] <= -COAL_ERROR for row in solved), sum(row["refused"] for row in rows)
    exempt = sum(row["exempt"] != [not carries for carries in row["carries"]] for row in solved)
    empty = [row for row in rows if row["empty"]]
    limited = sum(row["limited"] for row in empty)
    share = len(solved) / n
    return [
        Value("lifted and put down", "≥ 95 %", f"{100 * share:.3g} % of {n} {reasons}", share >= 0.95),
        Value("programs in contact by coal at 1 kHz", "0", f"{touching} of {len(solved)}", touching == 0),
        Value("a hand 1 to 30 mm in the surface, refused", f"{n}", f"{refused}", refused == n),
        Value("suction exempt elsewhere than where nothing is carried", "0", f"{exempt} of {len(solved)}", exempt == 0),
        Value(
            "without a payload, limited in every section", "all", f"{limited} of {len(empty)}", limited == len(empty)
        ),
    ]


if __name__ == "__main__":
    main("lifted", measure, CASES, judge)
