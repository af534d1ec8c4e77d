"""Motion problems in MotionBenchMaker's wording in tar files, read or generated: a MoveIt scene and a request for each.

Folders are named KIND_ARM, with ``scene0001.yaml`` and ``request0001.yaml`` for the first problem of a kind.
"""

from __future__ import annotations

import io
import json
import re
import tarfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from decimal import Decimal
from functools import lru_cache
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.file_io import parse_yaml
from optik.scene import Scene
from optik.scene.contact import find_contact, find_nearest_pairs
from optik.scene.files import scene_from_moveit
from optik.types import Array

MEMBER = re.compile(r"(?:^|/)(?P<kind>[^/]+)_[^/_]+/(?P<part>scene|request)(?P<number>\d+)\.yaml$")
"""Names of the files that are read; other files of the tar file are left out."""
TABLE, TABLE_EDGES = (0.55, 0.0, 0.1), (0.6, 1.4, 0.04)
"""Centre and edges of the table of generated problems [m]."""
OBJECTS, END_ROOM, DRAWN_ENDS = 5, 0.005, 256
"""Objects on a generated table; least room of both ends [m], less than neighbouring links have; configurations of a draw."""
TABLE_DRAWS = 100
"""Number of draws after which an arm counts as unable to reach the table."""
NEAR_TABLE = 0.5
"""Largest height of the tool above the table at both ends of a generated problem [m]."""


READ_PARTS = "joint_state of start_state, and joint_constraints of goal_constraints"
"""Parts of a request that are read."""


CUROBO_START = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
CUROBO_RADII, STAND = {0.03: 0.01}, ((-0.05, 0.0, -0.4), (0.3, 0.25, 0.8))
"""cuRobo's start of the Panda [rad], its radii of cylinders by the archive's, centre and edges of the box that it adds [m]."""


class MotionProblem(NamedTuple):
    """Obstacles, start and goal (joints or a pose) of a motion, and whether one end was moved onto a rounded joint limit."""

    scene: Scene
    start: Array
    goal: Array
    moved: bool = False


# ---------------------------------------------------------------- reading


@lru_cache(maxsize=4)
def read_archive(file: str | Path) -> dict[tuple[str, int], dict[str, str]]:
    """Return the texts of the scene and of the request of each problem, by kind and number."""
    found: dict[tuple[str, int], dict[str, str]] = {}
    try:
        with tarfile.open(file) as archive:
            for member in archive:
                name, content = MEMBER.search(member.name), archive.extractfile(member)
                if name and content is not None:
                    key = name["kind"], int(name["number"])
                    found.setdefault(key, {})[name["part"]] = content.read().decode()
    except (OSError, EOFError, UnicodeDecodeError, tarfile.TarError) as error:
        raise InvalidInput(
            "problems", f"{str(file)!r}: {str(error).splitlines()[0]}"[:160], "a tar file of problems"
        ) from None
    found = {key: found[key] for key in sorted(found) if len(found[key]) == 2}
    if not found:
        raise InvalidInput("problems", f"{str(file)!r} without one", "KIND_ARM/scene0001.yaml and request0001.yaml")
    return found


def read_problem(
    file: str | Path, kind: str, number: int, robot: Robot, grasping: tuple[str, ...] = ()
) -> MotionProblem:
    """Read one problem. With `grasping` the arm's own pairs count, and these parts may touch the object at the goal."""
    problems = read_archive(file)
    if (kind, number) not in problems:
        known = ", ".join(dict.fromkeys(kind for kind, _number in problems))
        raise InvalidInput("problem", f"{kind!r} {number}", f"a number of one of {known}"[:160])
    texts = problems[kind, number]
    ends = np.array([*_read_ends(parse_yaml(texts["request"], "request"), robot)])
    start, goal = inside = _move_onto_limits(robot, ends)
    moved = bool((inside != ends).any())
    entries = scene_from_moveit(texts["scene"])
    if not grasping:
        return MotionProblem(Scene(**entries), start, goal, moved)
    scene = Scene(**entries | {"allow": ()})  # the file's links are those of another model
    while (near := find_contact(robot, scene, goal)).pair[0] in grasping and near.room <= 0.0:
        if near.pair[1] not in scene.names:
            break
        scene = replace(scene, allow=(*scene.allow, *((part, near.pair[1]) for part in grasping)))
    return MotionProblem(scene, start, goal, moved)


def follow_curobo(robot: Robot, problem: MotionProblem) -> MotionProblem:
    """Return the problem by the rules of cuRobo's evaluation: a start, a goal pose, thinner cylinders, and a stand."""
    scene, at, before = problem.scene, np.eye(4), len(problem.scene.boxes)
    at[:3, 3] = STAND[0]
    cylinders = tuple((a, b, CUROBO_RADII.get(round(float(radius), 6), radius)) for a, b, radius in scene.cylinders)
    names = (*scene.names[:before], "stand", *scene.names[before:])
    boxes = (*scene.boxes, (at, np.array(STAND[1])))  # the base touches it, and neither moves
    scene = replace(scene, boxes=boxes, cylinders=cylinders, names=names, excess=np.zeros(len(names)))
    return MotionProblem(scene, np.array(CUROBO_START), robot.fk(problem.goal))


def _read_ends(request: Any, robot: Robot) -> Iterator[Array]:
    """Return the start and the goal in the order of the arm's joints."""
    try:
        state = request["start_state"]["joint_state"]
        start = dict(zip(map(str, state["name"]), map(float, state["position"]), strict=True))
        joints = request["goal_constraints"][0]["joint_constraints"]
        goal = {str(each["joint_name"]): float(each["position"]) for each in joints}  # YAML 1.1 reads 1e-5 as text
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise InvalidInput("request", f"{type(error).__name__}: {error}"[:80], READ_PARTS) from None
    names = _match_names(robot.joint_names, tuple(goal))
    for part, end in (("start_state", start), ("goal_constraints", goal)):
        if missing := [name for name in names if name not in end]:
            raise InvalidInput(f"request: {part}", f"no position of {missing[0]}", READ_PARTS)
        yield robot.configuration([end[name] for name in names], part)


def _move_onto_limits(robot: Robot, q: Array) -> Array:
    """Move joints onto a limit that they exceed by less than half a unit of its last digit; return the configurations."""
    for limit, nearer in ((robot.limits.lower, np.maximum), (robot.limits.upper, np.minimum)):
        printed = [Decimal(repr(float(x))) for x in limit]
        half = np.array([0.5 * 10.0 ** (x.adjusted() - len(x.as_tuple().digits) + 1) for x in printed])
        q = np.where(np.abs(q - limit) < half, nearer(q, limit), q)
    return q


def _match_names(joints: tuple[str, ...], given: tuple[str, ...]) -> tuple[str, ...]:
    """Return the given name of each joint: its own name, or all own names with one prefix and suffix more or less."""
    if set(joints) <= set(given):
        return joints
    (first, cores, last), (begin, others, end) = _split_names(joints), _split_names(given)
    extends = (first.endswith(begin) or begin.endswith(first)) and (last.startswith(end) or end.startswith(last))
    if not extends or sorted(cores) != sorted(others) or cores == [""]:
        expected = f"the joints {', '.join(joints)}, or these with one prefix and suffix more or less"
        raise InvalidInput("request", f"the joints {', '.join(given)}", expected)
    return tuple(given[others.index(core)] for core in cores)


def _split_names(names: tuple[str, ...]) -> tuple[str, list[str], str]:
    """Return the common prefix of names, what differs, and their common suffix."""
    prefix = _find_prefix(names)
    reverse = [name.removeprefix(prefix)[::-1] for name in names]
    suffix = _find_prefix(reverse)
    return prefix, [name.removeprefix(suffix)[::-1] for name in reverse], suffix[::-1]


def _find_prefix(names: Iterable[str]) -> str:
    return "".join(one[0] for one in takewhile(lambda one: len(set(one)) == 1, zip(*names, strict=False)))


# ---------------------------------------------------------------- generating


def write_problems(file: Path, robot: Robot, seed: int, count: int = 10) -> None:
    """Write problems in the same wording: a table with boxes, or with cylinders, and free ends near it.

    The straight motion between the ends is in contact. The problems of a seed are the same for any larger count.
    """
    with tarfile.open(file, "w:bz2") as archive:
        for index in range(count):
            kind, number = ("table_boxes", "table_cylinders")[index % 2], 1 + index // 2
            world = _draw_world(np.random.default_rng((seed, index)), kind)
            start, goal = _draw_ends(np.random.default_rng((seed, index, 1)), robot, world)
            named = [
                {"joint_name": name, "position": q} for name, q in zip(robot.joint_names, goal.tolist(), strict=True)
            ]
            state = {"joint_state": {"name": list(robot.joint_names), "position": start.tolist()}}
            request = {"start_state": state, "goal_constraints": [{"joint_constraints": named}]}
            for part, content in (("scene", world), ("request", request)):
                text = json.dumps(content, indent=1).encode()  # JSON is YAML
                member = tarfile.TarInfo(f"problems/{kind}_{robot.name.replace('_', '-')}/{part}{number:04d}.yaml")
                member.size = len(text)
                archive.addfile(member, io.BytesIO(text))


def _draw_world(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """Return a MoveIt scene: a table, and objects that stand on it."""
    objects = [_object("table", "box", TABLE_EDGES, TABLE, 0.0)]
    top = TABLE[2] + 0.5 * TABLE_EDGES[2]
    for k, y in enumerate(np.linspace(-0.5, 0.5, OBJECTS)):  # apart, so that the arm must move between or above them
        height, width, turn = rng.uniform(0.2, 0.45), rng.uniform(0.06, 0.12), rng.uniform(-np.pi, np.pi)
        boxes = kind == "table_boxes"
        shape, edges = ("box", (width, width, height)) if boxes else ("cylinder", (height, 0.5 * width))
        at = (rng.uniform(0.4, 0.65), float(y), top + 0.5 * height)
        objects.append(_object(f"object{k + 1}", shape, edges, at, turn))
    return {"world": {"collision_objects": objects}}


def _object(name: str, shape: str, dimensions: tuple[float, ...], at: tuple[float, ...], turn: float) -> dict[str, Any]:
    """Return a collision object of one primitive, turned about z."""
    pose = {"position": list(at), "orientation": [0.0, 0.0, float(np.sin(0.5 * turn)), float(np.cos(0.5 * turn))]}
    return {
        "id": name, "primitives": [{"type": shape, "dimensions": list(dimensions)}], "primitive_poses": [pose]
    }  # fmt: skip


def _draw_ends(rng: np.random.Generator, robot: Robot, world: dict[str, Any]) -> tuple[Array, Array]:
    """Draw free configurations with the tool near the table until a straight motion between two is in contact."""
    scene = Scene(**scene_from_moveit(json.dumps(world)))
    free = np.empty((0, robot.n))
    for _draw in range(TABLE_DRAWS):
        q = rng.uniform(robot.limits.lower, robot.limits.upper, (DRAWN_ENDS, robot.n))
        height, reach = robot.fk(q)[:, 2, 3] - TABLE[2], np.abs(robot.fk(q)[:, :2, 3] - TABLE[:2])
        above = (height > 0.0) & (height < NEAR_TABLE) & (reach <= 0.5 * np.array(TABLE_EDGES[:2])).all(1)
        q = q[above]
        free = np.concatenate([free, q[find_nearest_pairs(robot, scene, q)[0] > END_ROOM]])
        for start, goal in pairwise(free):
            if find_nearest_pairs(robot, scene, np.linspace(start, goal, 100))[0].min() < 0.0:
                return start, goal
    raise NoSolution(f"{robot.name} has no free ends near a table at {TABLE} m in {TABLE_DRAWS * DRAWN_ENDS:,} draws")
