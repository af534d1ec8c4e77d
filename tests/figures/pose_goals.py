"""Poses as goals and via points, and paths without a start, in scenes around a known motion: how many are solved; contacts.

The known motion proves that a configuration of each pose can be reached. It is not given to the planner.
"""

from __future__ import annotations

import itertools
import os
from functools import cache
from time import process_time
from typing import Any, NamedTuple

import numpy as np

import optik
from optik import Robot, Scene, se3
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners import Line, MotionLimits, Plan, PointToPoint, Polyline, free, plan
from planners.paths import ViaPoint
from planners.search import JointSpace
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import COAL_ERROR, Oracle, instants, pose

ARMS = ("paper6r", "panda_hand", "ur10e", "iiwa14", "ur5")
GOALS, WITHOUT_START = 200, 100
LIMITS = MotionLimits(1.5, 8.0, 80.0)
OBJECTS, GAP, NEAR = 12, 0.01, 0.15
"""Objects of a scene; their least distance from the known motion, and the greatest of most of them [m]."""


class Problem(NamedTuple):
    robot: Robot
    scene: Scene
    goal: Any
    q_start: Array | None
    avoid: bool
    kind: str


@cache
def arm(name: str) -> Robot:
    return optik.load(name)


def free_configurations(robot: Robot, rng: np.random.Generator, count: int) -> Array:
    """Configurations with at least 4 mm between links, or nearly as much as one in ten of the arm's has."""
    q = robot.limits.sample(rng, 400, half_if_infinite=np.pi)
    room = find_nearest_pairs(robot, Scene(), q)[0]
    return q[room >= 0.8 * min(0.005, np.quantile(room, 0.9))][:count]


def scene_around(robot: Robot, known: Array, rng: np.random.Generator) -> Scene:
    """Objects near the links of a known motion (k, n), at least `GAP` from it."""
    frames = robot.frames(known)[:, 1:, :3, 3].reshape(-1, 3)
    kinds: dict[str, list[Any]] = {"boxes": [], "spheres": [], "capsules": [], "cylinders": []}
    while sum(map(len, kinds.values())) < OBJECTS:
        centre = frames[rng.integers(len(frames))] + rng.normal(size=3) * NEAR
        kind = ("boxes", "spheres", "capsules", "cylinders")[rng.integers(4)]
        end = centre + 0.2 * rng.normal(size=3)
        one: Any = (centre, end, rng.uniform(0.02, 0.06))
        if kind == "boxes":
            one = pose(centre, se3.exp_so3(rng.normal(size=3))), tuple(rng.uniform(0.02, 0.3, 3))
        elif kind == "spheres":
            one = centre, rng.uniform(0.02, 0.1)
        if (find_nearest_pairs(robot, Scene(**{kind: [one]}, margin=GAP), known)[0] > 0.0).all():
            kinds[kind].append(one)
    return Scene(**kinds, margin=1e-3)


def goal_problem(robot: Robot, rng: np.random.Generator) -> Problem:
    """A pose as goal; every other time behind a pose as via point."""
    space = JointSpace(robot, Scene())
    while True:
        q = free_configurations(robot, rng, 3)
        if len(q) == 3 and all(space.is_edge_free(a, b) for a, b in itertools.pairwise(q)):
            break
    vias = rng.random() < 0.5
    q = q if vias else q[[0, 2]]
    if not vias and not space.is_edge_free(*q):
        return goal_problem(robot, rng)
    known = np.concatenate([a + np.linspace(0.0, 1.0, 150)[:, None] * (b - a) for a, b in itertools.pairwise(q)])
    scene = scene_around(robot, known, rng)
    if not vias:
        return Problem(robot, scene, robot.fk(q[1]), q[0], True, "goal")
    path = PointToPoint(robot, q[0], ViaPoint(robot.fk(q[1])), robot.fk(q[2]))
    return Problem(robot, scene, path, q[0], True, "via and goal")


def path_problem(robot: Robot, rng: np.random.Generator) -> Problem:
    """A path of the tool without a start; every other time with a free turn, or a free elbow, that avoids obstacles."""
    while True:
        q = free_configurations(robot, rng, 1)[0]
        poses = [robot.fk(q)]
        for _ in range(rng.integers(1, 3)):
            T = poses[-1].copy()
            T[:3, 3] += rng.normal(size=3) * 0.12
            T[:3, :3] = se3.exp_so3(0.3 * rng.normal(size=3)) @ T[:3, :3]
            poses.append(T)
        path = Line(*poses) if len(poses) == 2 else Polyline(np.stack(poses), blend=5e-3)
        known = plan(robot, path, q, limits=LIMITS, scene=Scene())
        if known:
            break
    scene = scene_around(robot, known.trajectory(np.linspace(0.0, known.trajectory.end, 300)), rng)
    if rng.random() < 0.5:
        return Problem(robot, scene, path, None, False, "path")
    freedoms = {"turn": 0.5} | ({"elbow": True} if robot.n > 6 else {})
    return Problem(robot, scene, free(path, **freedoms), None, True, "free path")


def problem(case: int) -> Problem:
    # Cases of both kinds alternate, so that a fraction of them has both.
    kind, number = (case % 3 == 2), case // 3
    rng = np.random.default_rng([41, case])
    robot = arm(ARMS[(number if kind else 2 * number + case % 3) % len(ARMS)])
    return path_problem(robot, rng) if kind else goal_problem(robot, rng)


def solve(given: Problem) -> Plan:
    return plan(given.robot, given.goal, given.q_start, limits=LIMITS, scene=given.scene, avoid=given.avoid)


def measure(case: int) -> Row:
    given = problem(case)
    begin = process_time()
    found = solve(given)
    row: Row = {"arm": given.robot.name, "kind": given.kind, "status": str(found.status), "cpu": process_time() - begin}
    if found.failure is not None:
        row["reason"] = found.failure.reason
    if found.has_motion:
        motion = found.trajectory
        near = Oracle(given.robot, given.scene).near(motion(instants(motion, 1000.0)), 0.05, 0.05)
        row["coal"] = float(min(near.scene.min(), near.own.min()))
        row["first"] = float(min(near.scene[0], near.own[0]))
        row["duration"] = motion.duration
        at, ends = motion(np.array([0.0, motion.end])), []
        if isinstance(given.goal, np.ndarray):
            ends = [given.robot.pose_errors(at[1], given.goal)]
        elif isinstance(given.goal, PointToPoint):
            ends = [given.robot.pose_errors(at[1], given.goal.points[-1].target), found.path.via_errors.ravel()]
        row["off"] = float(max((np.abs(x).max() for x in ends), default=0.0))
    return row


def judge(rows: list[Row]) -> list[Value]:
    values = []
    both = ("poses as goals and via points", ("goal", "via and goal")), ("without a start", ("path", "free path"))
    for words, kinds in both:
        for kind in kinds:
            mine = [row for row in rows if row["kind"] == kind]
            for name in ARMS:
                some = [row for row in mine if row["arm"] == arm(name).name]
                if some:
                    good = sum(row["status"] == "solved" for row in some)
                    print(
                        f"  {kind}, {name}: {good} of {len(some)}, CPU {np.median([row['cpu'] for row in some]):.2f} s"
                    )
        mine = [row for row in rows if row["kind"] in kinds]
        good = [row for row in mine if row["status"] == "solved"]
        for row in mine:
            if row["status"] != "solved":
                print(
                    f"  case {row['case']}, {row['arm']}, {row['kind']}: {row['status']}: {row.get('reason', '')}"[:300]
                )
        rate = len(good) / max(len(mine), 1)
        values.append(Value(f"{words}: solved", "≥ 99 %", f"{100 * rate:.1f} % of {len(mine)}", rate >= 0.99))
        wrong = [row for row in mine if row.get("first", 1.0) < -COAL_ERROR]
        values.append(Value(f"{words}: contacts at t = 0, by coal", "0", f"{len(wrong)}", not wrong))
        wrong = [row for row in good if row["coal"] < -COAL_ERROR]
        values.append(Value(f"{words}: solved with a contact at 1 kHz, by coal", "0", f"{len(wrong)}", not wrong))
        off = max((row["off"] for row in good), default=0.0)
        values.append(Value(f"{words}: largest error of a pose", "≤ 1e-6 m or rad", f"{off:.1e}", off <= 1e-6))
    return values


if __name__ == "__main__":
    main("pose_goals", measure, GOALS + WITHOUT_START, judge, part=float(os.environ.get("PART", 0.2)))
