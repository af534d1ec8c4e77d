"""Reader of MoveIt planning scenes (`moveit_msgs/PlanningScene`), as MoveIt and MotionBenchMaker write them.

Objects are boxes, spheres, cylinders, planes and convex meshes. `allowed_collision_matrix` becomes the allowed pairs of
links and objects; its pairs of two links belong to the arm (`Shapes.with_srdf`). The planning frame is the frame of the arm's
base, or of the world if `robot_state` places the arm's floating joint in it. Objects without a fixed frame are given in it,
so that the frame that they name must be one of the base or of the world.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from optik import se3
from optik.arm.plain import read_list, read_record, read_word
from optik.check import check_count, check_number, format_value
from optik.errors import InvalidInput
from optik.file_io import parse_yaml
from optik.scene.messages import POINT_DEFAULTS, find_mappings, read_fields, read_floats, read_pose, read_rows
from optik.scene.moveit_text import OBJECT_PARTS, message_from_text
from optik.types import Array

PRIMITIVES = {1: "box", 2: "sphere", 3: "cylinder"}
"""Types of `shape_msgs/SolidPrimitive` that are read, by number."""
DIMENSIONS = {"box": 3, "sphere": 1, "cylinder": 2}
"""Number of dimensions of each type: edges; radius; height and radius."""
ADD, REMOVE = (None, 0, "add", "\0", b"\0"), (1, "remove", "\1", b"\1")
"""Operations of an object: numbers, lower-case words, and bytes as ROS 2 prints them."""
PLANNING_SCENE_KEYS = (
    "name", "robot_state", "robot_model_name", "fixed_frame_transforms", "allowed_collision_matrix", "link_padding",
    "link_scale", "object_colors", "is_diff",
)  # fmt: skip
"""Keys of a `PlanningScene` besides its world."""
OBJECT_KEYS = ("header", "pose", "type", "operation", "subframe_names", "subframe_poses", *sum(OBJECT_PARTS, ()))
"""Keys of a `CollisionObject` besides its id."""
PLANNING_FRAMES = re.compile(
    r"(.*_)?(world|map|root|base|base_?link|link_?base|base_?footprint|link_?0)", re.IGNORECASE
)
"""Names that frames of a base or of the world have; a frame of another link would move with it."""
TRANSFORM = ("translation", "rotation")
"""Fields of a `geometry_msgs/Transform`."""
Part = tuple[str, str, Any]
"""Kind of object of a `Scene`, name, and arguments."""


@np.errstate(over="ignore", invalid="ignore")  # a scene refuses what is too far away
def scene_from_moveit(text: str, suffix: str = ".yaml") -> dict[str, Any]:
    """Read the arguments of a `Scene` from a MoveIt planning scene in YAML, or in its text format, ``.scene``."""
    data = message_from_text(text) if suffix == ".scene" else parse_yaml(text, "scene")
    scene = read_record(_find_scene(data), ("world",), "scene", optional=PLANNING_SCENE_KEYS)
    world = read_record(scene["world"], (), "world", optional=("collision_objects", "octomap"))
    state = read_fields(scene.get("robot_state") or {}, "robot_state")
    if attached := state.get("attached_collision_objects"):
        got = f"{len(attached) if isinstance(attached, list) else format_value(attached)} attached objects"
        raise InvalidInput("robot_state", got, "none: Shapes.with_part attaches objects to a link")
    octomap = read_fields(world.get("octomap") or {}, "world.octomap")
    if read_fields(octomap.get("octomap") or {}, "world.octomap.octomap").get("data"):
        expected = "none, because it is not read: its cells as clouds= of Scene"
        raise InvalidInput("world.octomap", "an octomap with data", expected)
    _check_links(scene)
    frames, known = _Frames(scene, state), dict[str, str]()
    parts, notes = list[Part](), ["is_diff: the objects of the file are the whole scene"] * bool(scene.get("is_diff"))
    for i, one in enumerate(read_rows(world, "collision_objects", "world")):
        where = f"collision_objects[{i}]"
        name = read_word(read_record(one, ("id",), where, optional=OBJECT_KEYS)["id"], f"{where}.id")
        operation = one.get("operation")
        operation = operation.lower() if isinstance(operation, str) else operation
        if operation in REMOVE:  # an empty id means every object
            parts = [part for part in parts if name and part[1] != name]
            known = {other: place for other, place in known.items() if name and other != name}
            notes.append(f"REMOVE in {where} removes {repr(name) if name else 'every object'} before it")
            continue
        if known.setdefault(name, where) != where:
            raise InvalidInput(f"{where}.id", repr(name)[:60], f"an id that differs from that of {known[name]}")
        if operation not in ADD:
            raise InvalidInput(f"{where}.operation", format_value(operation), "ADD (0) or REMOVE (1)")
        T = frames.find(one, where) @ read_pose(one.get("pose") or {}, f"{where}.pose")
        found = list(_read_object(one, name, T, where))
        if not found:
            raise InvalidInput(where, f"{name!r} without parts", "primitives, planes or meshes")
        parts += found
    order = ("boxes", "spheres", "planes", "cylinders", "meshes")
    parts.sort(key=lambda part: order.index(part[0]))  # the order of names in a `Scene`
    objects = {kind: [one for other, _, one in parts if other == kind] for kind in order}
    ids = [name for _, name, _ in parts]
    names = make_unique(ids)
    allowed = _read_allowed(scene.get("allowed_collision_matrix") or {}, set(ids))
    allow = [(link, name) for link, one in allowed for name, of in zip(names, ids, strict=True) if of == one]
    return {**objects, "names": names, "allow": allow, "notes": tuple(notes)}


def _find_scene(data: Any) -> Any:
    """Return the first scene at any depth of a message, or a scene of a single object."""
    for one in find_mappings(data):
        if "world" in one:
            return one
        if "collision_objects" in one:
            return {"world": one}
    return {"world": {"collision_objects": [data]}} if "id" in read_fields(data, "scene") else data


def _check_links(scene: dict[str, Any]) -> None:
    """Refuse links that are larger or smaller than the arm's."""
    for key, value, usual in (("link_padding", "padding", 0.0), ("link_scale", "scale", 1.0)):
        for i, row in enumerate(read_rows(scene, key, "scene")):
            found = check_number(read_fields(row, f"{key}[{i}]").get(value, usual), f"{key}[{i}].{value}", "a number")
            if found != usual:
                expected = f"{usual:g}, because links keep their size: margin= of Scene is for all of them"
                raise InvalidInput(f"{key}[{i}].{value}", found, expected)


def make_unique(names: list[str]) -> tuple[str, ...]:
    """Make names unique: the second object of a name becomes name#2, and so on."""
    found: list[str] = []
    count: dict[str, int] = {}
    for name in names:
        count[name] = count.get(name, 0) + 1
        found.append(name if count[name] == 1 else f"{name}#{count[name]}")
    return tuple(found)


def _read_object(one: dict[str, Any], name: str, T: Array, where: str) -> Iterator[Part]:
    """Read the parts of an object at a pose."""
    for key, poses in OBJECT_PARTS:
        rows = read_rows(one, key, where)
        given = (one.get(poses) if rows else None) or [{}] * len(rows)
        places = read_list(given, f"{where}.{poses}", f"{len(rows)} poses", len(rows))
        for k, (row, place) in enumerate(zip(rows, places, strict=True)):
            at = f"{where}.{key}[{k}]"
            read = {"primitives": _primitive, "planes": _plane, "meshes": _mesh}[key]
            kind, arguments = read(read_fields(row, at), T @ read_pose(place, f"{where}.{poses}[{k}]"), at)
            yield kind, name, arguments


def _primitive(row: dict[str, Any], T: Array, where: str) -> tuple[str, tuple[Any, ...]]:
    kind = row.get("type")
    if isinstance(kind, int) and not isinstance(kind, bool):
        kind = PRIMITIVES.get(kind)
    kind = str(kind).lower()
    if kind not in DIMENSIONS:
        raise InvalidInput(f"{where}.type", format_value(row.get("type")), ", ".join(DIMENSIONS))
    values = read_floats(row.get("dimensions"), f"{where}.dimensions", DIMENSIONS[kind])
    if kind == "box":
        return "boxes", (T, values)
    if kind == "sphere":
        return "spheres", (T[:3, 3], values[0])
    half = 0.5 * values[0] * T[:3, 2]
    return "cylinders", (T[:3, 3] - half, T[:3, 3] + half, values[1])


def _plane(row: dict[str, Any], T: Array, where: str) -> tuple[str, tuple[Any, ...]]:
    """Read a plane a x + b y + c z + d = 0; the free side is that of (a, b, c)."""
    *normal, d = read_floats(row.get("coef"), f"{where}.coef", 4)
    if not (largest := np.abs(normal).max()):
        raise InvalidInput(f"{where}.coef", format_value(row.get("coef")), "a normal that is not 0")
    n = np.array(normal) / largest  # avoids overflow of the squares
    return "planes", (T[:3, :3] @ (-(d / largest) / (n @ n) * n) + T[:3, 3], T[:3, :3] @ n)


def _mesh(row: dict[str, Any], T: Array, where: str) -> tuple[str, Array]:
    points = read_rows(row, "vertices", where)
    read = (read_floats(point, f"{where}.vertices[{i}]", 3, POINT_DEFAULTS) for i, point in enumerate(points))
    corners, triangles = np.array(list(read)), []
    for i, triangle in enumerate(read_rows(row, "triangles", where)):
        at = f"{where}.triangles[{i}]"
        three = read_list(read_fields(triangle, at).get("vertex_indices"), at, "three indices", 3)
        for k in three:
            check_count(k, at, 0, len(points) - 1)
        triangles.append(corners[three])
    if not triangles:
        raise InvalidInput(f"{where}.triangles", "none", "triangles of a closed convex mesh")
    return "meshes", np.array(triangles) @ T[:3, :3].T + T[:3, 3]


class _Frames:
    """The poses of named frames in the frame of the arm's base."""

    def __init__(self, scene: dict[str, Any], state: dict[str, Any]) -> None:
        moving = read_fields(state.get("multi_dof_joint_state") or {}, "robot_state.multi_dof_joint_state")
        bases = read_rows(moving, "transforms", "multi_dof_joint_state")
        if len(bases) > 1:
            raise InvalidInput("multi_dof_joint_state", f"{len(bases)} floating joints", "at most one, of the base")
        base = read_pose(bases[0], "multi_dof_joint_state.transforms[0]", TRANSFORM) if bases else np.eye(4)
        self._world, self._known, self._other = se3.inverse(base), {"": np.eye(4)}, ""
        for i, row in enumerate(read_rows(scene, "fixed_frame_transforms", "scene")):
            where = f"fixed_frame_transforms[{i}]"
            T = read_pose(read_fields(row, where).get("transform"), f"{where}.transform", TRANSFORM)
            self._known[read_word(row.get("child_frame_id"), f"{where}.child_frame_id").strip("/")] = T

    def find(self, one: dict[str, Any], where: str) -> Array:
        """Return the pose of the frame that an object is given in; one frame without a transform is the planning frame."""
        header = read_fields(one.get("header") or {}, f"{where}.header")
        name = read_word(header.get("frame_id") or "", f"{where}.header.frame_id").strip("/")
        if name not in self._known:
            if self._other or not PLANNING_FRAMES.fullmatch(name):
                usual = repr(self._other[:60]) if self._other else "a frame of the base or of the world"
                raise InvalidInput(f"{where}.header.frame_id", repr(name)[:60], f"{usual}, or a fixed frame")
            self._known[name], self._other = np.eye(4), name
        return np.asarray(self._world @ self._known[name])


def _read_allowed(matrix: Any, objects: set[str]) -> list[tuple[str, str]]:
    """Return the pairs of a link and an object that may touch."""
    where = "allowed_collision_matrix"
    read_fields(matrix, where)
    names, every = (
        [read_word(name, f"{where}.{key}") for name in read_rows(matrix, key, where)]
        for key in ("entry_names", "default_entry_names")
    )
    rows = read_list(matrix.get("entry_values") or [], f"{where}.entry_values", f"{len(names)} rows", len(names))
    found = {}
    for name, row in zip(names, rows, strict=True):
        flags = row.get("enabled") if isinstance(row, dict) else row
        flags = read_list(flags, f"{where}.entry_values", f"{len(names)} of true or false in each row", len(names))
        for other, flag in zip(names, flags, strict=True):
            if flag is True and name not in objects and other in objects:
                found[name, other] = True
    flags = read_list(matrix.get("default_entry_values") or [], f"{where}.default_entry_values", "flags", len(every))
    for name, flag in zip(every, flags, strict=True):
        for link in names:
            if flag is True and name in objects and link not in objects:
                found[link, name] = True
    return list(found)
