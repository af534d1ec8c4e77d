"""Readers of scenes: TOML in millimetres and degrees, JSON, URDF, ROS messages, and MoveIt scenes in both formats.

A TOML file contains optional tables of objects, in the frame of the arm's base:

    margin_mm = 10.0                          # a distance at or below it counts as contact
    allow = [["base", "table"]]               # pairs that are not checked: a link of the arm, and an object

    [[boxes]]
    name = "table"                            # optional: by default box1, box2, …
    xyz_mm = [400.0, 0.0, -25.0]              # of the centre
    rpy_deg = [0.0, 0.0, 30.0]                # optional: roll, pitch and yaw; or quaternion_wxyz, quaternion_xyzw, …
    edges_mm = [800.0, 1200.0, 50.0]          # full lengths along the box's axes

    [[spheres]]
    centre_mm = [500.0, 0.0, 300.0]
    radius_mm = 60.0

    [[capsules]]                              # all points within a radius of a segment
    a_mm = [600.0, 300.0, 0.0]
    b_mm = [600.0, 300.0, 900.0]
    radius_mm = 30.0

    [[planes]]                                # all points behind a plane
    name = "floor"
    point_mm = [0.0, 0.0, -700.0]
    normal = [0.0, 0.0, 1.0]                  # to the free side, of any length

    [[cylinders]]                             # with flat ends
    a_mm = [600.0, -300.0, 0.0]               # centres of both ends
    b_mm = [600.0, -300.0, 120.0]
    radius_mm = 40.0

    [[meshes]]                                # the convex hull of its corners
    corners_mm = [[500.0, 0.0, 0.0], [600.0, 0.0, 0.0], [500.0, 100.0, 0.0], [500.0, 0.0, 80.0]]

    [[clouds]]                                # balls around points
    points_mm = [[500.0, 0.0, 400.0], [500.0, 10.0, 400.0]]
    radius_mm = 10.0
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optik import se3
from optik.arm.plain import ORIENTATIONS, make_rotation, read_list, read_pose, read_record, read_vector, read_word
from optik.arm.shapes.urdf import find_geometry, find_mesh_folders, read_geometry, read_length, read_triangles
from optik.arm.urdf_tree import joint_origin, name_file, origin_pose, read_tree, read_triple
from optik.check import check_count, check_number, format_value, locate_error
from optik.errors import InvalidInput, RobotModelError
from optik.file_io import check_suffix, decode_text, parse_json, parse_toml, parse_yaml, read_bytes
from optik.scene.distance import is_convex
from optik.types import Array

# ---------------- rOS messages as plain data of YAML or JSON


NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second; ROS times are whole nanoseconds."""
LONGEST_DURATION = 2**31 - 1
"""Longest ROS duration [s]: its seconds are a signed integer of 32 bits."""
TIME_FORMS = (("sec", "nanosec"), ("secs", "nsecs"))
"""Fields of a time in ROS 2 and in ROS 1."""
POINT_DEFAULTS, ROTATION_DEFAULTS = {"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
"""Fields of a point or vector, and of a quaternion, with their defaults."""


def find_mappings(data: Any) -> Iterator[dict[str, Any]]:
    """Yield all mappings in nested plain data, the outermost first."""
    todo, seen = [data], set[int]()
    for value in todo:  # the list grows during the loop
        if isinstance(value, dict | list) and id(value) not in seen:  # YAML aliases can repeat a mapping
            seen.add(id(value))
            todo += value.values() if isinstance(value, dict) else value
            if isinstance(value, dict):
                yield value


def read_fields(value: Any, where: str, known: Iterable[str] | None = None) -> dict[str, Any]:
    """Check that a value is a mapping, with known fields only."""
    if not isinstance(value, dict):
        raise InvalidInput(where, format_value(value), "a mapping of named fields")
    for other in (key for key in value if known is not None and key not in known):
        raise InvalidInput(where, f"the field {other!r}"[:60], f"some of {', '.join(known or ())}")
    return value


def read_rows(value: dict[str, Any], key: str, where: str) -> list[Any]:
    """Read a list of a message; a missing one is empty."""
    return read_list(value.get(key) or [], f"{where}.{key}", "a list")


def read_floats(value: Any, where: str, count: int, fields: dict[str, float] | None = None) -> Array:
    """Read finite numbers (count,) from a list or from named fields with defaults; YAML 1.1 reads 1e-5 as text."""
    expected = f"{count} finite numbers"
    if isinstance(value, dict) and fields is not None:
        value = list((fields | read_fields(value, where, fields)).values())
    rows = read_list(value, where, expected, count)
    if all(type(x) is float for x in rows) and np.isfinite(array := np.array(rows)).all():
        return array
    out = []
    for x in rows:
        try:
            x = float(x) if isinstance(x, str) else x
        except ValueError:
            raise InvalidInput(where, format_value(x), expected) from None
        out.append(check_number(x, where, expected))
    return np.array(out)


def read_pose_message(value: Any, where: str, names: tuple[str, str] = ("position", "orientation")) -> Array:
    """Read a pose (4, 4) [1, m] from a point and a quaternion x, y, z, w; missing fields are 0, a missing w is 1."""
    parts = read_fields(value, where, names)
    p = read_floats(parts.get(names[0], {}), f"{where}.{names[0]}", 3, POINT_DEFAULTS)
    q = read_floats(parts.get(names[1], {}), f"{where}.{names[1]}", 4, ROTATION_DEFAULTS)
    return se3.pose(make_rotation("quaternion_xyzw", q, f"{where}.{names[1]}"), p)


def read_time(value: Any, where: str) -> int:
    """Read a time or duration [ns], of ROS 2 or 1, or in float seconds; missing fields are 0."""
    if type(value) is float and 0.0 <= value <= LONGEST_DURATION:
        return round(value * NANOSECONDS)
    if isinstance(value, dict):
        for fields in TIME_FORMS:
            sec, nanosec = (value.get(field, 0) for field in fields)
            good = type(sec) is int and type(nanosec) is int and set(value) <= set(fields)
            if good and 0 <= sec <= LONGEST_DURATION and 0 <= nanosec < NANOSECONDS:
                return int(sec * NANOSECONDS + nanosec)
    expected = "sec and nanosec, integers from 0; secs and nsecs of ROS 1; or seconds with a decimal point"
    raise InvalidInput(where, repr(value)[:80], expected)


# ---------------- reader of MoveIt's text format of scenes (``.scene``)


OBJECT_PARTS = (("primitives", "primitive_poses"), ("planes", "plane_poses"), ("meshes", "mesh_poses"))
"""Keys of the parts of an object, and of their poses."""


def message_from_text(text: str) -> dict[str, Any]:
    """Return the planning scene of a text as a message."""
    lines, objects = enumerate(io.StringIO(text), start=1), []
    number, line = next(lines, (0, ""))

    def take() -> list[str]:
        nonlocal number, line
        number, line = next((number, line) for number, line in lines if line.strip())
        return line.split()

    def add_shape(one: dict[str, Any]) -> None:
        (kind,), values = take(), take()
        sizes = values[::-1] if kind == "cylinder" else values  # radius and length
        shape: dict[str, Any] = {"type": kind, "dimensions": sizes, "coef": values}
        if kind == "mesh":
            corners, triangles = map(int, values)
            shape = {"vertices": [take() for _ in range(corners)]}
            shape["triangles"] = [{"vertex_indices": [int(word) for word in take()]} for _ in range(triangles)]
        shapes, poses = {"plane": OBJECT_PARTS[1], "mesh": OBJECT_PARTS[2]}.get(kind, OBJECT_PARTS[0])
        one.setdefault(shapes, []).append(shape)
        one.setdefault(poses, []).append({"position": take(), "orientation": take()})
        take()  # its colour

    try:
        while take() != ["."]:
            one: dict[str, Any] = {"id": line[line.index("*") + 1 :].strip()}
            newer = len(words := take()) > 1
            if newer:
                one["pose"], words = {"position": words, "orientation": take()}, take()
            for _ in range(int(*words)):
                add_shape(one)
            for _ in range(3 * int(*take()) if newer else 0):  # name, position and orientation of each subframe
                take()
            objects.append(one)
    except (StopIteration, ValueError, TypeError):
        got = repr(line.strip())[:60]
        raise InvalidInput(f"line {number}", got, "a complete scene in MoveIt's text format") from None
    return {"world": {"collision_objects": objects}}


# ---------------- reader of MoveIt planning scenes (`moveit_msgs/PlanningScene`)


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
        T = frames.find(one, where) @ read_pose_message(one.get("pose") or {}, f"{where}.pose")
        shapes = list(_read_object(one, name, T, where))
        if not shapes:
            raise InvalidInput(where, f"{name!r} without parts", "primitives, planes or meshes")
        parts += shapes
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
            kind, arguments = read(read_fields(row, at), T @ read_pose_message(place, f"{where}.{poses}[{k}]"), at)
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
        base = read_pose_message(bases[0], "multi_dof_joint_state.transforms[0]", TRANSFORM) if bases else np.eye(4)
        self._world, self._known, self._other = se3.inverse(base), {"": np.eye(4)}, ""
        for i, row in enumerate(read_rows(scene, "fixed_frame_transforms", "scene")):
            where = f"fixed_frame_transforms[{i}]"
            T = read_pose_message(read_fields(row, where).get("transform"), f"{where}.transform", TRANSFORM)
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
    allowed = {}
    for name, row in zip(names, rows, strict=True):
        flags = row.get("enabled") if isinstance(row, dict) else row
        flags = read_list(flags, f"{where}.entry_values", f"{len(names)} of true or false in each row", len(names))
        for other, flag in zip(names, flags, strict=True):
            if flag is True and name not in objects and other in objects:
                allowed[name, other] = True
    flags = read_list(matrix.get("default_entry_values") or [], f"{where}.default_entry_values", "flags", len(every))
    for name, flag in zip(every, flags, strict=True):
        for link in names:
            if flag is True and name in objects and link not in objects:
                allowed[link, name] = True
    return list(allowed)


# ---------------- readers of scenes


OBJECT_KINDS = ("boxes", "spheres", "capsules", "planes", "cylinders", "meshes", "clouds")
"""Kinds of objects, in the order of their names."""
MOST_SCENE_BYTES = 64 * 2**20
"""Largest file that is read [bytes]: 600 bytes for each object of the largest scene."""
ROW_KEYS = {
    "boxes": (("xyz_mm", "edges_mm"), (*ORIENTATIONS, "name")),
    "spheres": (("centre_mm", "radius_mm"), ("name",)),
    "capsules": (("a_mm", "b_mm", "radius_mm"), ("name",)),
    "planes": (("point_mm", "normal"), ("name",)),
    "cylinders": (("a_mm", "b_mm", "radius_mm"), ("name",)),
    "meshes": (("corners_mm",), ("name",)),
    "clouds": (("points_mm", "radius_mm"), ("name",)),
}
"""Required and optional keys of a row of each kind."""
SCENE_KEYS = (*OBJECT_KINDS, "allow", "names", "excess", "margin")
"""Keys of a scene in JSON: the fields of `Scene`."""
LATER_KINDS = ("cylinders", "meshes", "clouds")
"""Kinds of objects that a scene in JSON may lack: files of scenes without them stay the same."""


def load_scene(
    file: str | os.PathLike[str],
    package_dirs: Mapping[str, str | os.PathLike[str]] | Sequence[str | os.PathLike[str]] | None = None,
) -> dict[str, Any]:
    """Read a scene from a file; see `Scene.load`."""
    suffix = check_suffix(file, (".toml", ".json", ".urdf", ".xml", ".yaml", ".yml", ".scene"), "scene")
    urdf, path = suffix in (".urdf", ".xml"), Path(file)
    if package_dirs is not None and not urdf:
        raise InvalidInput("package_dirs", "folders", "none: only a URDF names meshes")
    expected = "a readable file of a scene"
    content = b"" if urdf else read_bytes(path, argument="scene", expected=expected, most=MOST_SCENE_BYTES)
    try:
        if urdf:
            with name_file(file):
                return scene_from_urdf(file, package_dirs)
        text = decode_text(content)
        if suffix == ".json":
            return scene_from_dict(parse_json(text, "scene"))
        return scene_from_toml(text) if suffix == ".toml" else scene_from_moveit(text, suffix)
    except InvalidInput as error:
        raise locate_error(path.name, error) from None


TINY = 2e-3
"""Longest edge of a box [m] up to which its millimetres are probably metres."""


def scene_from_toml(text: str) -> dict[str, Any]:
    """Read a scene from TOML, in the format that this module describes."""
    data = parse_toml(text, "scene")
    read_record(data, (), "scene", optional=(*OBJECT_KINDS, "allow", "margin_mm"))
    objects: dict[str, list[Any]] = {kind: [] for kind in OBJECT_KINDS}
    names = []
    for kind in OBJECT_KINDS:
        for i, row in enumerate(read_list(data.get(kind, []), f"scene.{kind}", f"tables [[{kind}]]")):
            where = f"{kind}[{i}]"
            required, optional = ROW_KEYS[kind]
            read_record(row, required, where, optional=optional)
            objects[kind].append(_object(kind, row, where))
            names.append(read_word(row.get("name", name_object(kind, i)), f"{where}.name"))
    margin = check_number(data.get("margin_mm", 0.0), "scene.margin_mm", "millimetres, 0 or more", least=0.0) / 1000.0
    tiny = [name for name, (_, edges) in zip(names, objects["boxes"], strict=False) if edges.max() < TINY]
    notes = [f"{', '.join(tiny)}: edges below {1e3 * TINY:g} mm: are these metres?"] if tiny else []
    return {**objects, "allow": data.get("allow", ()), "names": tuple(names), "margin": margin, "notes": notes}


def _object(kind: str, row: Mapping[str, Any], where: str) -> tuple[Any, ...] | Array:
    """Return the arguments of one object of `Scene`, in metres."""

    def lengths(key: str) -> Array:
        return read_vector(row[key], f"{where}.{key}") / 1000.0

    if kind == "boxes":
        return read_pose(row, where, optional=("edges_mm", "name")), lengths("edges_mm")
    if kind == "planes":
        return lengths("point_mm"), read_vector(row["normal"], f"{where}.normal")
    if kind in ("meshes", "clouds"):
        key = "corners_mm" if kind == "meshes" else "points_mm"
        rows = read_list(row[key], f"{where}.{key}", "a list of points")
        points = np.array([read_vector(point, f"{where}.{key}[{i}]") for i, point in enumerate(rows)]) / 1000.0
        if kind == "meshes":
            return points
    radius = check_number(row["radius_mm"], f"{where}.radius_mm", "a length above 0", above=0.0) / 1000.0
    if kind == "clouds":
        return points, radius
    return (*(lengths(key) for key in (("centre_mm",) if kind == "spheres" else ("a_mm", "b_mm"))), radius)


def name_object(kind: str, i: int) -> str:
    """Return the default name of object i of a kind: box1, …."""
    word = {"boxes": "box", "meshes": "mesh"}.get(kind, kind.removesuffix("s"))
    return f"{word}{i + 1}"


def scene_to_dict(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene as plain data; see `Scene.to_dict`."""

    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else value

    objects = {kind: [[plain(part) for part in one] for one in scene[kind]] for kind in OBJECT_KINDS}
    excess = [None if e != e else e for e in scene["excess"].tolist()]
    rest = {"names": list(scene["names"]), "excess": excess, "margin": scene["margin"]}
    objects = {kind: rows for kind, rows in objects.items() if rows or kind not in LATER_KINDS}
    return objects | {"allow": [list(pair) for pair in scene["allow"]]} | rest


def scene_from_dict(data: Any) -> dict[str, Any]:
    """Read a scene from plain data; see `Scene.from_dict`."""
    required = tuple(key for key in SCENE_KEYS if key not in LATER_KINDS)
    data = {key: [] for key in LATER_KINDS} | dict(read_record(data, required, "scene", optional=LATER_KINDS))
    for key in SCENE_KEYS[:-1]:
        read_list(data[key], f"scene.{key}", "a list")
    known = data["excess"]
    excess = [np.nan if e is None else check_number(e, "scene.excess", "lengths ≥ 0", least=0.0) for e in known]
    return {**data, "excess": np.array(excess)}


def scene_from_urdf(
    source: str | os.PathLike[str],
    package_dirs: Mapping[str, str | os.PathLike[str]] | Sequence[str | os.PathLike[str]] | None = None,
) -> dict[str, Any]:
    """Read a scene from a URDF; see `Scene.load`."""
    tree, folders = read_tree(source, None), find_mesh_folders(source, package_dirs)
    objects: dict[str, list[tuple[str, Any, float]]] = {
        kind: [] for kind in ("boxes", "spheres", "capsules", "cylinders", "meshes")
    }
    poses: dict[str, Array] = {tree.root: np.eye(4)}
    todo = [tree.root]
    for link in todo:  # grows while it is read
        for child in tree.below.get(link, ()):
            poses[child] = poses[link] @ joint_origin(tree.name, tree.above[child])
            todo.append(child)
        for element in tree.parts(link, "collision"):
            where = f"<collision> of link {link!r}"
            T = poses[link] @ origin_pose(tree.name, where, element.find(f"{tree.prefix}origin"))
            kind, shape = find_geometry(tree, element)
            if kind == "box":
                edges = read_triple(tree.name, where, shape.get("size", ""), "box size")
                objects["boxes"].append((link, (T, edges), 0.0))
                continue
            if kind == "cylinder":
                radius, length = (read_length(tree.name, where, kind, shape, name) for name in ("radius", "length"))
                a, b = (T[:3, 3] + side * 0.5 * length * T[:3, 2] for side in (-1.0, 1.0))
                objects["cylinders"].append((link, (a, b, radius), 0.0))
                continue
            if kind == "mesh":
                triangles = read_triangles(tree.name, shape, where, folders)
                if is_convex(triangles):
                    objects["meshes"].append((link, triangles @ T[:3, :3].T + T[:3, 3], 0.0))
                    continue
            for c in read_geometry(tree, element, where, folders):
                a, b = (T[:3, :3] @ end + T[:3, 3] for end in (c.a, c.b))
                one = (a, c.radius) if kind == "sphere" else (a, b, c.radius)
                objects["spheres" if kind == "sphere" else "capsules"].append((link, one, c.excess))
    listed = [one for kind in objects.values() for one in kind]
    if not listed:
        raise RobotModelError(tree.name, "no <collision> on any link")
    shapes = {kind: [one for _, one, _ in rows] for kind, rows in objects.items()}
    excess = np.array([e for *_, e in listed])
    return {**shapes, "names": make_unique([name for name, *_ in listed]), "excess": excess}
