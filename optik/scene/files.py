"""Readers of scenes: TOML in millimetres and degrees, JSON, URDF, and MoveIt scenes (`optik.scene.moveit`).

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

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optik.arm.plain import ORIENTATIONS, read_list, read_pose, read_record, read_vector, read_word
from optik.arm.shapes.meshes import find_mesh_folders
from optik.arm.shapes.urdf import find_geometry, read_geometry, read_length, read_triangles
from optik.arm.urdf_tree import joint_origin, name_file, origin_pose, read_tree, read_triple
from optik.check import check_number, locate_error
from optik.errors import InvalidInput, RobotModelError
from optik.file_io import check_suffix, decode_text, parse_json, parse_toml, read_bytes
from optik.scene.mesh import is_convex
from optik.scene.moveit import make_unique, scene_from_moveit
from optik.types import Array

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
            names.append(read_word(row.get("name", f"{_singular(kind)}{i + 1}"), f"{where}.name"))
    margin = check_number(data.get("margin_mm", 0.0), "scene.margin_mm", "millimetres, 0 or more", least=0.0) / 1000.0
    return {**objects, "allow": data.get("allow", ()), "names": tuple(names), "margin": margin}


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


def _singular(kind: str) -> str:
    return {"boxes": "box", "meshes": "mesh"}.get(kind, kind.removesuffix("s"))


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
    found = [one for kind in objects.values() for one in kind]
    if not found:
        raise RobotModelError(tree.name, "no <collision> on any link")
    shapes = {kind: [one for _, one, _ in rows] for kind, rows in objects.items()}
    excess = np.array([e for *_, e in found])
    return {**shapes, "names": make_unique([name for name, *_ in found]), "excess": excess}
