"""Capsules that enclose the <collision> elements of a URDF."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from optik.arm.branches import Axis, find_driver, read_range
from optik.arm.shapes.cache import enclose_once
from optik.arm.shapes.enclosure import Capsule, box_triangles
from optik.arm.shapes.hulls import enclose_body, enclose_disc
from optik.arm.shapes.meshes import FARTHEST_CORNER, MeshFolders, read_mesh, read_mesh_bytes
from optik.arm.shapes.model import Shapes
from optik.arm.shapes.sweep import SweepStep, sweep_capsules
from optik.arm.urdf_tree import Joint, Tree, check_plain, joint_origin, origin_pose, read_number, read_triple
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array

Rows: TypeAlias = list[tuple[int, Array, str]]
"""Links of a chain: number of the arm's link, pose in its frame, and name."""


def read_shapes(tree: Tree, base: str, placed: list[tuple[Joint, Array]], folders: MeshFolders, axis: Axis) -> Shapes:
    """Read the shapes of a chain of links and of the links that branch off it.

    Branches behind fixed joints move with their link. Branches behind movable joints, such as the fingers of a gripper, are
    enclosed for all positions of these joints, so their excess is unknown.
    """
    chain = {base, *(joint.child for joint, _ in placed)}
    carried: dict[str, list[tuple[str, Capsule]]] = {link: [] for link in chain}
    unread: list[tuple[str, str]] = []
    for link in tree.list_below(base):
        if found := _read_own(tree, link, folders, unread):
            carrier, steps, ranges = find_steps(tree, link, chain, axis)
            if steps:
                found = enclose_once(partial(sweep_capsules, found, steps, ranges), found, steps, ranges)
            carried[carrier] += [(link, c) for c in found]
    rows = place_links(base, placed)
    capsules = [(i, name, c.transform(T)) for i, T, link in rows for name, c in carried[link]]
    if not capsules and not unread:
        raise RobotModelError(tree.name, "no <collision> on any link of the chain")
    return Shapes(
        [(i, c.a, c.b, c.radius) for i, _, c in capsules],  # type: ignore[arg-type]
        tuple(name for _, name, _ in capsules),
        excess=np.array([c.excess for *_, c in capsules]),
        source=f"<collision> of URDF {tree.name!r}",
        unread=tuple(unread),
        hulls=tuple(c.hulls for *_, c in capsules) if any(c.hulls for *_, c in capsules) else (),
    )


def place_links(base: str, placed: list[tuple[Joint, Array]]) -> Rows:
    """Return for each link of a chain the number of the arm's link that it belongs to, its pose there, and its name."""
    rows = [(0, np.eye(4), base)]
    for joint, T in placed:
        rows.append((rows[-1][0] + (joint.kind != "fixed"), T, joint.child))
    return rows


def read_surface(tree: Tree, link: str, T: Array, folders: MeshFolders) -> Array:
    """Read the triangles (k, 3, 3) of a link's own meshes at a pose; none if another shape belongs to it."""
    found, where = [np.zeros((0, 3, 3))], f"<collision> of link {link!r}"
    for element in tree.parts(link, "collision"):
        kind, shape = find_geometry(tree, element)
        if kind != "mesh":
            return found[0]
        place = T @ origin_pose(tree.name, where, element.find(f"{tree.prefix}origin"))
        found.append(read_triangles(tree.name, shape, where, folders) @ place[:3, :3].T + place[:3, 3])
    return np.concatenate(found)


def _read_own(tree: Tree, link: str, folders: MeshFolders, unread: list[tuple[str, str]]) -> list[Capsule]:
    """Read the capsules of a link's own <collision> elements, in its frame; append the reason to `unread` if one fails."""
    found = []
    for element in tree.parts(link, "collision"):
        where = f"<collision> of link {link!r}"
        try:
            T = origin_pose(tree.name, where, element.find(f"{tree.prefix}origin"))
            found += [c.transform(T) for c in read_geometry(tree, element, where, folders)]
        except RobotModelError as error:
            unread.append((link, error.problem.removeprefix(f"{where}: ")))
        except InvalidInput as error:
            unread.append((link, str(error).removeprefix(f"{where}: ")))
    return found


def find_steps(tree: Tree, link: str, chain: set[str], axis: Axis) -> tuple[str, list[SweepStep], Array]:
    """Return the link of the chain that carries a link, the joints between them, and the ranges (d, 2) of their drivers."""
    steps: list[SweepStep] = []
    drivers: dict[str, tuple[float, float]] = {}
    while link not in chain:
        joint, T = tree.above[link], joint_origin(tree.name, tree.above[link])
        if joint.kind == "fixed":
            steps.append(SweepStep(T, False, np.array([0.0, 0.0, 1.0]), 0, 0.0, 0.0))
        else:
            driver, factor, offset = find_driver(tree, joint)
            drivers.setdefault(driver.name, read_range(tree.name, driver))
            number, slides = list(drivers).index(driver.name), joint.kind == "prismatic"
            if slides and not np.isfinite(drivers[driver.name]).all():
                problem = f"joint {joint.name!r}: type 'prismatic' without limits: the space of its links is unknown"
                raise RobotModelError(tree.name, problem)
            read_range(tree.name, joint)  # a joint of another type, or crossed limits
            steps.append(SweepStep(T, slides, axis(joint), number, factor, offset))
        link = joint.parent
    ranges = np.array(list(drivers.values())).reshape(-1, 2)
    for i, (low, high) in enumerate(ranges.tolist()):
        moved = [step for step in steps if step.factor and step.driver == i]
        if high - low > 2.0 * np.pi and all(abs(step.factor) == 1.0 and not step.slides for step in moved):
            ranges[i] = -np.pi, np.pi  # one turn is all there is
    return link, steps, ranges


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
    file, scale = _find_mesh(robot, shape, where, folders)
    return _scale(read_mesh(file), scale)


def _find_mesh(robot: str, shape: Any, where: str, folders: MeshFolders) -> tuple[Path, Array]:
    """Return the file of a <mesh>, and its scale (3,)."""
    scale = read_triple(robot, where, shape.get("scale", "1 1 1"), "mesh scale")
    return folders.file(check_plain(shape.get("filename", "")), where), scale


def _scale(triangles: Array, scale: Array) -> Array:
    with np.errstate(over="ignore"):
        return np.asarray(triangles * scale)


def read_geometry(tree: Tree, element: Any, where: str, folders: MeshFolders) -> list[Capsule]:
    """Enclose the geometry of a <collision> by capsules, in its own frame."""
    kind, shape = find_geometry(tree, element)
    length = partial(read_length, tree.name, where, kind, shape)

    def enclosed(triangles: Array) -> list[Capsule]:
        farthest = float(np.abs(triangles).max())
        if not farthest <= FARTHEST_CORNER:
            problem = f"{where}: the {kind} extends to {farthest:.6g} m, expected at most {FARTHEST_CORNER:g} m"
            raise RobotModelError(tree.name, problem)
        return enclose_body(triangles)

    if kind == "box":
        edges = read_triple(tree.name, where, shape.get("size", ""), "box size")
        if (edges <= 0.0).any():
            raise RobotModelError(tree.name, f"{where}: box size {edges.tolist()}, expected lengths above 0")
        return enclose_once(lambda: enclosed(box_triangles(edges)), edges)
    if kind == "sphere":
        return [Capsule(np.zeros(3), np.zeros(3), length("radius"), 0.0)]
    if kind == "cylinder":
        return enclose_disc(length("radius"), length("length"))
    if kind == "capsule":
        end = np.array([0.0, 0.0, 0.5 * length("length")])
        return [Capsule(-end, end, length("radius"), 0.0)]
    if kind == "mesh":
        file, scale = _find_mesh(tree.name, shape, where, folders)
        return enclose_once(lambda: enclosed(_scale(read_mesh(file), scale)), read_mesh_bytes(file), file.suffix, scale)
    raise RobotModelError(tree.name, f"{where}: {kind[:40]!r}, expected a box, sphere, cylinder, capsule or mesh")
