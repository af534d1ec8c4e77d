"""A scene as shapes of a chain: the objects are attached to the link that does not move in the world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from optik import se3
from optik.arm.shapes.enclosure import CORNERS, ENCLOSURE_ROUNDING, Hull, complete_frame
from optik.arm.shapes.hulls import enclose_disc
from optik.arm.shapes.model import Shapes
from optik.errors import InvalidInput, UnknownName
from optik.scene.cloud import divide_cloud
from optik.scene.contact import ALLOWED
from optik.types import Array

if TYPE_CHECKING:
    from optik.arm.group import Group
    from optik.arm.robot import Robot
    from optik.scene import Scene

Body = tuple[str, Array, Array, float, tuple[Hull, ...]]
"""Name, ends of the segment (3,) and radius of a capsule [m], and hulls in it."""


def chain_in_scene(group: Group, frame: str, tool: str, scene: Scene) -> Robot:
    """Return `Group.chain` with the objects of a scene in the world on the link that carries the bases of both members."""
    chain, first, second = group.chain(frame, tool), group.members[frame], group.members[tool]
    if (shapes := chain.shapes) is None:
        missing = " and ".join(name for name in (frame, tool) if group.members[name].shapes is None)
        raise InvalidInput("group", f"{missing} without shapes", "members with shapes: robot.with_shapes(...)")
    centre = 0.5 * (first.fixed[0][:3, 3] + second.fixed[0][:3, 3])
    reach = max(_find_reach(arm, centre) for arm in (first, second)) + scene.margin
    bodies = list(_list_bodies(scene, centre, reach))
    if not bodies:
        return chain
    links, *old, radii = shapes.capsules
    excess = dict(zip(scene.names, scene.excess, strict=True))
    N, T = len(first.fixed), np.diag([1.0, -1.0, -1.0, 1.0]) @ se3.inverse(first.fixed[0])
    names, parts = (*shapes.names, *(one[0] for one in bodies)), [one[4] for one in bodies]
    new = ([T[:3, :3] @ end + T[:3, 3] for end in column] for column in zip(*(one[1:3] for one in bodies), strict=True))
    ends = [np.concatenate([known, added]) for known, added in zip(old, new, strict=True)]
    capsules: Any = (np.append(links, np.full(len(bodies), N)), *ends, np.append(radii, [one[3] for one in bodies]))
    hulls = [*(shapes.hulls or ((),) * shapes.m), *(tuple(hull.transform(T) for hull in of) for of in parts)]
    allowed = [(part, name, ALLOWED) for link, name in scene.allow for part in _find_parts(group, link, shapes)]
    return chain.with_shapes(replace(
        shapes, capsules=capsules, names=names, apart=(*shapes.apart, *(one for one in allowed if one[1] in names)),
        hulls=tuple(hulls), excess=np.append(shapes.excess, [excess[one[0]] for one in bodies]),
        mechanism=(*shapes.mechanism, *(2 for _ in bodies)),
    ))  # fmt: skip


def _find_parts(group: Group, link: str, shapes: Shapes) -> list[str]:
    """Return the names of a member's capsules: of a part, or of a link ``"arm/joint2"``."""
    member, _, own = link.partition("/")
    parts = [name for name in dict.fromkeys(shapes.names) if name == link or name.startswith(f"{link} ")]
    if member in group.members and not parts and own in group.members[member].link_names:
        robot = group.members[member]
        assert robot.shapes is not None
        of = robot.shapes.find_capsules(robot.link_names.index(own))
        parts = [f"{member}/{robot.shapes.names[i]}" for i in of]
    if not parts and not (member in group.members and own in group.members[member].link_names):
        raise UnknownName("link in scene.allow", link, dict.fromkeys(shapes.names))
    return [name for name in parts if name in shapes.names]


def _find_reach(arm: Robot, centre: Array) -> float:
    """Return a distance from a point of the world within which all shapes of an arm stay."""
    assert arm.shapes is not None
    ends, fixed = arm.axes.limits, arm.fixed[:, :3, 3] - np.vstack([centre, np.zeros((len(arm.fixed) - 1, 3))])
    slides = np.where(arm.axes.prismatic, np.maximum(np.abs(ends.lower), np.abs(ends.upper)), 0.0)
    far = np.cumsum(np.linalg.norm(fixed, axis=1) + slides)
    link, a, b, radius = arm.shapes.capsules
    origin = np.where(link[:, None] == 0, centre, 0.0)
    size = np.maximum(np.linalg.norm(a - origin, axis=1), np.linalg.norm(b - origin, axis=1)) + radius
    return float((np.append(0.0, far)[link] + size).max())


def _list_bodies(scene: Scene, centre: Array, reach: float) -> Iterator[Body]:
    """Yield the parts of objects within reach of a point, enlarged by the margin."""
    names, grow = iter(scene.names), scene.margin
    for T, edges in scene.boxes:
        yield from _clip_box(next(names), T, (-0.5 * edges, 0.5 * edges), centre, reach, grow)
    for a, b, radius in [*((c, c, r) for c, r in scene.spheres), *scene.capsules]:
        yield next(names), a, b, radius + grow, ()
    for point, normal in scene.planes:
        behind = np.full(3, -np.inf), np.array([np.inf, np.inf, 0.0])
        yield from _clip_box(next(names), _pose_along(point, normal), behind, centre, reach, grow)
    for a, b, radius in scene.cylinders:
        length = float(np.linalg.norm(b - a))
        disc = enclose_disc(radius, length)[0].transform(_pose_along(0.5 * (a + b), (b - a) / length))
        hulls = tuple(hull._replace(radius=hull.radius + grow) for hull in disc.hulls)
        yield next(names), disc.a, disc.b, disc.radius + grow, hulls
    for corners in scene.meshes:
        yield _enclose(next(names), np.eye(4), corners, [Hull(corners, grow, 0.0)])
    for points, radius in scene.clouds:
        name = next(names)
        for part in divide_cloud(points):
            yield _enclose(name, np.eye(4), part, [Hull(point[None], radius + grow, 0.0) for point in part])


def _pose_along(point: Array, z: Array) -> Array:
    """Return a pose at a point with its z axis along a unit vector."""
    return se3.pose(np.column_stack([*complete_frame(z), z]), point)


def _clip_box(
    name: str, T: Array, ends: tuple[Array, Array], centre: Array, reach: float, grow: float
) -> Iterator[Body]:
    """Yield the part of a box, between corners (3,) in its frame T, that is within reach, if there is one."""
    at = T[:3, :3].T @ (centre - T[:3, 3])
    low, high = np.maximum(ends[0], at - reach), np.minimum(ends[1], at + reach)
    if (low < high).all():
        corners = 0.5 * (low + high) + CORNERS * (high - low)
        yield _enclose(name, T, corners, [Hull(corners, grow, 0.0).transform(T)])


def _enclose(name: str, T: Array, points: Array, hulls: list[Hull]) -> Body:
    """Return a capsule that encloses points (k, 3) in a frame T, with hulls in it."""
    low, high = points.min(axis=0), points.max(axis=0)
    along, middle = np.eye(3)[int(np.argmax(high - low))], 0.5 * (low + high)
    away = (points - middle) * (1.0 - along)
    radius = float(np.linalg.norm(away, axis=1).max(initial=0.0)) + ENCLOSURE_ROUNDING
    half = 0.5 * float(along @ (high - low))
    a, b = (T[:3, :3] @ (middle + side * half * along) + T[:3, 3] for side in (-1.0, 1.0))
    return name, a, b, radius + hulls[0].radius, tuple(hulls)
