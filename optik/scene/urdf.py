"""Reader of a scene from the <collision> elements of a URDF, with every joint at 0."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from optik.arm.shapes.meshes import find_mesh_folders
from optik.arm.shapes.urdf import find_geometry, read_geometry
from optik.arm.urdf_tree import joint_origin, origin_pose, read_tree, read_triple
from optik.errors import RobotModelError
from optik.types import Array


def scene_from_urdf(
    source: str | os.PathLike[str],
    package_dirs: Mapping[str, str | os.PathLike[str]] | Sequence[str | os.PathLike[str]] | None = None,
) -> dict[str, Any]:
    """Read a scene from a URDF; see `Scene.load`."""
    tree, folders = read_tree(source, None), find_mesh_folders(source, package_dirs)
    objects: dict[str, list[tuple[str, tuple[Any, ...], float]]] = {"boxes": [], "spheres": [], "capsules": []}
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
            for c in read_geometry(tree, element, where, folders):
                a, b = (T[:3, :3] @ end + T[:3, 3] for end in (c.a, c.b))
                one = (a, c.radius) if kind == "sphere" else (a, b, c.radius)
                objects["spheres" if kind == "sphere" else "capsules"].append((link, one, c.excess))
    found = [one for kind in objects.values() for one in kind]
    if not found:
        raise RobotModelError(tree.name, "no <collision> on any link")
    shapes = {kind: [one for _, one, _ in rows] for kind, rows in objects.items()}
    excess = np.array([e for *_, e in found])
    return {**shapes, "names": _make_unique([name for name, *_ in found]), "excess": excess}


def _make_unique(names: list[str]) -> tuple[str, ...]:
    """Make names unique: the second object of a name becomes name#2, and so on."""
    found: list[str] = []
    count: dict[str, int] = {}
    for name in names:
        count[name] = count.get(name, 0) + 1
        found.append(name if count[name] == 1 else f"{name}#{count[name]}")
    return tuple(found)
