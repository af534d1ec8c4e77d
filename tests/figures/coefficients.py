"""Lines with freedoms among obstacles that 8 coefficients do not solve but 12, 20 or 40 do: solved by default?

A panda with capsules follows a random line with a free elbow, turn and tilt. Two to four spheres touch the motion along the
given line, 3 to 20 mm deep, and leave start and goal free. `SEEDS` are the first random problems, of all from 0 on, that
explicit numbers of coefficients show to be such; `measure` checks it again.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from optik import Scene
from optik.arm.robot import Robot
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners import Line, MotionLimits, Plan, free, plan
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import REST, panda

SEED = 20261125
SEEDS = (1, 5, 7, 9, 10, 11, 15, 16, 28, 30, 31, 38, 49, 55, 67, 78, 80, 94, 102, 103)
LIMITS = MotionLimits(2.0, 10.0, 100.0)
FEWEST, MORE = 8, (12, 20, 40)
PROBE, MARGIN = 0.4, 1e-3
"""Radius of the sphere that measures distances [m]: so large that it is nearer to the arm than its links to each other."""


def problem(seed: int) -> tuple[Robot, Line, Array, Scene] | None:
    """An arm, a line, its start and a scene; None if the line is out of reach or no spheres are found."""
    robot, rng = panda(), np.random.default_rng([SEED, seed])
    q = REST + rng.uniform(-0.3, 0.3, 7)
    T, way = robot.fk(q), rng.normal(size=3)
    goal = T.copy()
    goal[:3, 3] += rng.uniform(0.2, 0.35) * way / np.linalg.norm(way)
    first = plan(robot, Line(T, goal), q, limits=LIMITS)
    if not first:
        return None
    joints = first.trajectory(np.linspace(0.1, 0.9, 400) * first.trajectory.duration)
    spheres: list[tuple[Array, float]] = []
    count = int(rng.integers(2, 5))
    for _ in range(40):
        if len(spheres) == count:
            return robot, Line(T, goal), q, Scene(spheres=spheres, margin=MARGIN)
        k, link, way = int(rng.integers(60, 340)), int(rng.integers(4, 8)), rng.normal(size=3)
        at = robot.frames(joints[k])[link][:3, 3] + rng.uniform(0.09, 0.2) * way / np.linalg.norm(way)
        room = find_nearest_pairs(robot, Scene(spheres=[(at, PROBE)]), joints)[0] + PROBE
        radius = float(room.min() + rng.uniform(0.003, 0.02))
        if 0.01 < radius < min(room[0] - 0.01, room[-1] - 0.01, 0.15):
            spheres.append((at, radius))
    return None


def solve(seed: int, count: int | None) -> Plan:
    """The plan of a problem with a number of coefficients, or with the default."""
    found = problem(seed)
    assert found is not None
    robot, path, q, scene = found
    freed = free(path, elbow=True, turn=(-1.0, 1.0), tilt=0.3, coefficients=count)
    return plan(robot, freed, q, limits=LIMITS, scene=scene, avoid=True)


def measure(case: int) -> Row:
    seed = SEEDS[case]
    few = solve(seed, FEWEST)
    more = next((count for count in MORE if solve(seed, count)), None)
    begin = time.process_time()
    found = solve(seed, None)
    row: Row = {"seed": seed, "few": str(few.status), "more": more, "status": str(found.status)}
    row["cpu"] = time.process_time() - begin
    if not found:
        return row
    scene, t = found.scene, np.linspace(0.0, found.trajectory.duration, 4001)
    assert scene is not None
    return row | {"room": float(find_nearest_pairs(found.robot, scene, found.trajectory(t))[0].min())}


def judge(rows: list[Row]) -> Sequence[Value]:
    kept = [row for row in rows if row["few"] != "solved" and row["more"] is not None]
    solved = [row for row in kept if row["status"] == "solved"]
    rooms = min((row["room"] for row in solved), default=np.nan)
    return [
        Value(
            "problems that 8 coefficients fail and more solve", f"{len(rows)}", f"{len(kept)}", len(kept) == len(rows)
        ),
        Value("solved by default", "all", f"{len(solved)} of {len(kept)}", len(solved) == len(kept)),
        Value("least room at 4,001 instants beyond the margin", "above 0", f"{1e3 * rooms:.3g} mm", rooms > 0.0),
    ]


if __name__ == "__main__":
    main("coefficients", measure, len(SEEDS), judge)
