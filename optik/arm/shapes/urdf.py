"""Capsules that enclose the <collision> elements of a URDF."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from optik.arm.shapes.enclosure import Capsule, box_triangles, enclose_cylinder, enclose_mesh, fit_capsule
from optik.arm.shapes.meshes import FARTHEST_CORNER, MeshFolders, read_mesh
from optik.arm.shapes.model import Shapes
from optik.arm.urdf_tree import Joint, Tree, joint_origin, origin_pose, read_number, read_triple
from optik.errors import RobotModelError
from optik.types import Array

Axis = Callable[[Joint], Array]
"""Unit axis (3,) of a joint in its own frame."""


def read_shapes(tree: Tree, base: str, placed: list[tuple[Joint, Array]], folders: MeshFolders, axis: Axis) -> Shapes:
    """Read the shapes of a chain of links and of the links that branch off it.

    Branches behind fixed joints move with their link. Branches behind movable joints, such as the fingers of a gripper, are
    enclosed for all positions of these joints, so their excess is unknown.
    """
    chain = {joint.child for joint, _ in placed}
    carried: dict[str, list[tuple[str, Capsule]]] = {}
    for link in reversed(_order_links(tree, base)):  # children before parents
        found = [(link, c) for c in _read_own(tree, link, folders)]
        for child in tree.below.get(link, ()):
            if child not in chain:
                joint = tree.above[child]
                T = joint_origin(tree.name, joint)
                found += [(name, _sweep(tree.name, joint, c, axis).transform(T)) for name, c in carried.pop(child)]
        carried[link] = found
    rows = [(0, np.eye(4), base)]
    for joint, T in placed:
        rows.append((rows[-1][0] + (joint.kind != "fixed"), T, joint.child))
    capsules = [(i, name, c.transform(T)) for i, T, link in rows for name, c in carried[link]]
    if not capsules:
        raise RobotModelError(tree.name, "no <collision> on any link of the chain")
    return Shapes(
        [(i, c.a, c.b, c.radius) for i, _, c in capsules],  # type: ignore[arg-type]
        tuple(name for _, name, _ in capsules),
        excess=np.array([c.excess for *_, c in capsules]),
        source=f"<collision> of URDF {tree.name!r}",
    )


def _read_own(tree: Tree, link: str, folders: MeshFolders) -> list[Capsule]:
    """Read the capsules of a link's own <collision> elements, in the link's frame."""
    found = []
    for element in tree.parts(link, "collision"):
        where = f"<collision> of link {link!r}"
        T = origin_pose(tree.name, where, element.find(f"{tree.prefix}origin"))
        found += [c.transform(T) for c in read_geometry(tree, element, where, folders)]
    return found


def _order_links(tree: Tree, base: str) -> list[str]:
    """List a link and the links below it, parents first."""
    found = [base]
    for link in found:  # grows while it is read
        found += tree.below.get(link, ())
    return found


def _sweep(robot: str, joint: Joint, c: Capsule, axis: Axis) -> Capsule:
    """Return a capsule that encloses another for all positions of its joint, in the frame before the joint."""
    if joint.kind == "fixed":
        return c
    where = f"joint {joint.name!r}"
    if joint.kind in ("revolute", "continuous"):  # a capsule about the axis contains all rotations
        u = axis(joint)
        along = np.array([c.a @ u, c.b @ u])
        across = max(float(np.linalg.norm(end - (end @ u) * u)) for end in (c.a, c.b))
        return Capsule(along.min() * u, along.max() * u, c.radius + across)
    limit = joint.element.get("limit")
    if joint.kind != "prismatic" or limit is None or limit.get("lower") is None or limit.get("upper") is None:
        raise RobotModelError(robot, f"{where}: type {joint.kind!r} without limits: the space of its links is unknown")
    ends = [read_number(robot, where, limit.get(side), f"{side} limit") * axis(joint) for side in ("lower", "upper")]
    corners = np.array([end + shift for end in (c.a, c.b) for shift in ends])
    hull = fit_capsule(corners[[[0, 1, 2], [1, 2, 3]]])
    return Capsule(hull.a, hull.b, hull.radius + c.radius)


# ---------------------------------------------------------------- geometries


def find_geometry(tree: Tree, element: Any) -> tuple[str, Any]:
    """Return the kind and element of the geometry of a <collision>."""
    outer = element.find(f"{tree.prefix}geometry")
    for child in () if outer is None else outer:
        if isinstance(child.tag, str):  # not a comment
            return child.tag.removeprefix(tree.prefix), child
    return "nothing", None


def read_length(robot: str, where: str, kind: str, shape: Any, name: str) -> float:
    """Return a length of a geometry [m], such as the radius of a sphere."""
    value = read_number(robot, where, shape.get(name, ""), f"{kind} {name}")
    if not 0.0 < value <= FARTHEST_CORNER:
        expected = f"a length above 0 of at most {FARTHEST_CORNER:g} m"
        raise RobotModelError(robot, f"{where}: {kind} {name} {value:.6g}, expected {expected}")
    return value


def read_triangles(robot: str, shape: Any, where: str, folders: MeshFolders) -> Array:
    """Read the triangles (k, 3, 3) of a <mesh> [m]."""
    scale = read_triple(robot, where, shape.get("scale", "1 1 1"), "mesh scale")
    with np.errstate(over="ignore"):
        return np.asarray(read_mesh(folders.file(shape.get("filename", ""), where)) * scale)


def read_geometry(tree: Tree, element: Any, where: str, folders: MeshFolders) -> list[Capsule]:
    """Enclose the geometry of a <collision> by capsules, in its own frame."""
    kind, shape = find_geometry(tree, element)
    length = partial(read_length, tree.name, where, kind, shape)

    def enclosed(triangles: Array) -> list[Capsule]:
        farthest = float(np.abs(triangles).max())
        if not farthest <= FARTHEST_CORNER:
            problem = f"{where}: the {kind} extends to {farthest:.6g} m, expected at most {FARTHEST_CORNER:g} m"
            raise RobotModelError(tree.name, problem)
        return enclose_mesh(triangles)

    if kind == "box":
        edges = read_triple(tree.name, where, shape.get("size", ""), "box size")
        if (edges <= 0.0).any():
            raise RobotModelError(tree.name, f"{where}: box size {edges.tolist()}, expected lengths above 0")
        return enclosed(box_triangles(edges))
    if kind == "sphere":
        return [Capsule(np.zeros(3), np.zeros(3), length("radius"), 0.0)]
    if kind == "cylinder":
        return [enclose_cylinder(length("radius"), length("length"))]
    if kind == "capsule":
        end = np.array([0.0, 0.0, 0.5 * length("length")])
        return [Capsule(-end, end, length("radius"), 0.0)]
    if kind == "mesh":
        return enclosed(read_triangles(tree.name, shape, where, folders))
    raise RobotModelError(tree.name, f"{where}: {kind[:40]!r}, expected a box, sphere, cylinder, capsule or mesh")
