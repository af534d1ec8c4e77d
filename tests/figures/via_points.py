"""`PointToPoint` through random via points: how many are solved, their durations over stop-and-go, and lengths of the lines.

The points are random configurations. Some are given as the tool's pose there, so the line through the configurations that are
chosen must not be longer than that through the given ones. A move with stops passes the same configurations: the sum of the
`optimal` durations of straight joint lines between them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

import optik
from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.errors import OptikError
from optik.types import Array
from planners import JointLine, MotionLimits, PointToPoint, ViaPoint, plan
from tests.figures.figure import Row, Value, main
from tests.figures.moving import span

SEED = 20261125
LIMITS = MotionLimits(2.0, 10.0, 100.0)
ARMS = ("ur5e", "kr6", "gen3lite", "puma560", "panda", "irb910sc", "rail")
ISOLATED = ("ur5e", "kr6", "gen3lite", "puma560", "irb910sc")
"""Arms that reach a pose in a finite number of configurations, windings aside."""
TOLERANCE = (5e-3, 0.09)
COUNT, MOST_VIAS = 300, 6
EQUAL, SHORTEST, LONGEST = 0.8, 0.01, 2.0
"""Length of equal legs, and the least and the greatest of unequal ones [rad, m]."""
LENGTHENING = 2.0
"""Largest length of the first path over that of the line through its points."""


def arm_of(name: str) -> Robot:
    """An arm by its name, or ur5e on a rail of 3 m."""
    if name != "rail":
        return optik.load(name)
    ur5e, turned = optik.load("ur5e"), np.eye(4)
    turned[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]  # z of the rail is x of the arm's base
    fixed = np.concatenate([turned[None], turned.T[None] @ ur5e.fixed[:1], ur5e.fixed[1:]])
    lower, upper = (np.append(1.5 * sign, x) for sign, x in ((-1.0, ur5e.limits.lower), (1.0, ur5e.limits.upper)))
    return Robot("rail", fixed, np.append(True, ur5e.prismatic), ur5e.tool, JointLimits(lower, upper))


def points_of(robot: Robot, case: int) -> list[Array]:
    """A random start and one to seven further configurations inside the limits, with equal or unequal distances."""
    rng, (low, high) = np.random.default_rng([SEED, case]), span(robot)
    q = [low + (high - low) * rng.uniform(0.2, 0.8, robot.n)]
    for _ in range(case // len(ARMS) % (MOST_VIAS + 1) + 1):
        length = EQUAL if case % 2 else float(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
        while True:
            way = rng.normal(size=robot.n)
            x = q[-1] + length * way / np.linalg.norm(way)
            if ((x >= low) & (x <= high)).all():
                break
            length *= 0.99  # a sliding joint's range may be short
        q.append(x)
    return q


def measure(case: int) -> Row:
    name, rng = ARMS[case % len(ARMS)], np.random.default_rng([SEED, case, 1])
    robot = arm_of(name)
    given = points_of(robot, case)
    points: list[Any] = []
    for i, q in enumerate(given[1:]):
        target = robot.fk(q) if rng.random() < 0.5 else q
        points.append(ViaPoint(target, TOLERANCE if i < len(given) - 2 and rng.random() < 0.3 else None))
    row: Row = {"arm": name, "vias": len(points) - 1, "equal": bool(case % 2), "given": measure_line(given)}
    begin = time.process_time()
    try:
        path = PointToPoint(robot, given[0], *points)
        chosen = time.process_time()
        found = plan(robot, path, limits=LIMITS)
    except OptikError as error:
        return row | {"status": f"{type(error).__name__}: {error}"[:300]}
    row |= {"status": str(found.status), "cpu": time.process_time() - begin, "choice": chosen - begin}
    q = [given[0], *(via.q for via in path.vias), path.coefficients[-1]]
    row |= {"line": measure_line(q)}
    s = np.unique(np.concatenate([np.linspace(a, b, 100) for a, b in pairwise(path.breaks)]))
    row["path"] = measure_line(path.configurations(robot, s))
    if not found:
        return row | {"reason": found.failure.reason[:300] if found.failure else ""}
    stops = [plan(robot, JointLine(robot, a, b), limits=LIMITS).trajectory.duration for a, b in pairwise(q)]
    return row | {"T": found.trajectory.duration / sum(stops), "duration": found.trajectory.duration}


def measure_line(q: Any) -> float:
    """Length of the line through configurations."""
    return float(np.linalg.norm(np.diff(np.array(q), axis=0), axis=1).sum())


def judge(rows: list[Row]) -> Sequence[Value]:
    solved = [row for row in rows if "T" in row]
    T = np.array([row["T"] for row in solved])
    lines = np.array([row["line"] / row["given"] for row in rows if "line" in row and row["arm"] in ISOLATED])
    free = np.array([row["line"] / row["given"] for row in rows if "line" in row and row["arm"] not in ISOLATED])
    paths = np.array([row["path"] / row["line"] for row in rows if "path" in row])
    cpu = np.array([row["choice"] for row in rows if "choice" in row])
    return [
        Value("solved", "≥ 99.5 %", f"{len(solved)} of {len(rows)}", len(solved) >= 0.995 * len(rows)),
        Value(
            "duration over stop-and-go", "never above 1", f"median {np.median(T):.3f}, at most {T.max():.6f}",
            bool(T.max() <= 1.0 + 1e-6),
        ),
        Value(
            "line through the chosen configurations over that through the given ones, isolated", "at most 1",
            f"median {np.median(lines):.3f}, at most {lines.max():.9f}, of {lines.size}", bool(lines.max() <= 1.0 + 1e-9),
        ),
        Value(
            "the same, redundant arms", "at most 1", f"median {np.median(free):.3f}, at most {free.max():.9f}, of {free.size}",
            bool(free.max() <= 1.0 + 1e-9),
        ),
        Value(
            "first path over the line", f"at most {LENGTHENING:g}",
            f"median {np.median(paths):.3f}, at most {paths.max():.3f}", bool(paths.max() <= LENGTHENING),
        ),
        Value("CPU of the choice", "below 1 s", f"median {np.median(cpu):.3f} s, {cpu.max():.3f} s", bool(cpu.max() < 1.0)),
    ]  # fmt: skip


if __name__ == "__main__":
    main("via_points", measure, COUNT, judge)
