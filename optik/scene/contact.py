"""Collision pairs of an arm and a scene, and the smallest distance at given configurations."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik import kinematics
from optik.arm.shapes.check import Capsules
from optik.arm.shapes.enclosure import CORNERS, Hull
from optik.arm.shapes.hulls import Hulls, enclose_disc, list_balls, list_hulls, nearest_hulls, pack_hulls
from optik.arm.shapes.model import PAYLOAD
from optik.check import check_kind
from optik.compiled import compiled, inlined
from optik.kinematics import Chain, Triple
from optik.scene.cloud import count_parts, divide_cloud, segment_cloud
from optik.scene.distance import (
    DISTANCE_ROUNDING,
    NearestPoint,
    segment_box,
    segment_cylinder,
    segment_mesh,
    segment_plane,
    segment_segment,
)
from optik.types import Array, Indices

if TYPE_CHECKING:
    from optik.arm.robot import Robot
    from optik.arm.shapes.model import Shapes
    from optik.scene import Scene

BOX, ROUND, PLANE, SELF, CYLINDER, MESH, CLOUD = 0, 1, 2, 3, 4, 5, 6
"""Kinds of the second body of a pair: a box, a sphere or capsule, a plane, a capsule of the arm, a cylinder, a mesh, or a
part of a cloud, numbered after the meshes."""
Objects = tuple[Array, Array, Array, Array, Array, Array, Array]
"""A scene as kernels take it, `optik.Scene.arrays`: box_pose (b, 4, 4), box_half (b, 3), capsule_a, capsule_b (c, 3),
capsule_radius (c,), planes (p, 6), and `pack_solids` [m, 1]."""
Bodies = tuple[Capsules, Objects, Indices, Hulls]
"""The capsules of an arm, the scene, the checked pairs (k, 3): capsule, number of the second body among those of its kind, and
that kind; and the hulls of both. Of two capsules of the arm the first is on the later link."""
ADVISING_SAMPLES = 1000
"""Number of random configurations by which an advice tells whether a pair of shapes can be apart."""
HULLS_FROM = 0.01
"""Room of capsules [m] up to which the hulls decide: above 0, so that the room has no steps where capsules begin to touch."""
ALLOWED, STILL, TOUCHING = "allowed by the scene", "neither moves", "neither moves: in contact"
"""Reasons why a capsule and an object are not checked."""


class Pairs(NamedTuple):
    """Pairs of shapes that are checked, as in `Bodies`, their names, the pairs left out with the reasons, and the hulls."""

    bodies: Indices
    names: tuple[tuple[str, str], ...]
    left_out: tuple[tuple[str, str, str], ...]
    hulls: Hulls


@lru_cache(maxsize=16)
def find_pairs(robot: Robot, scene: Scene) -> Pairs:
    """Return the pairs of shapes that are checked: those whose distance can change, except allowed ones."""
    examined = scene.pair_mask(robot)
    assert robot.shapes is not None
    shapes, link = robot.shapes, robot.shapes.capsules[0]
    between_links = [(i, j, SELF) if link[i] > link[j] else (j, i, SELF) for i, j in shapes.pairs.tolist()]
    between_links.sort(key=lambda pair: (link[pair[0]], link[pair[1]]))  # so that two links are one block
    kinds = [(i, BOX) for i in range(len(scene.boxes))]
    kinds += [(i, ROUND) for i in range(len(scene.spheres) + len(scene.capsules))]
    kinds += [(i, PLANE) for i in range(len(scene.planes))] + [(i, CYLINDER) for i in range(len(scene.cylinders))]
    kinds += [(i, MESH) for i in range(len(scene.meshes))]
    parts = [count_parts(len(points)) for points, _ in scene.clouds]
    kinds += [(len(scene.meshes) + i, CLOUD) for i in range(sum(parts))]
    counts = np.array([1] * (len(scene.names) - len(parts)) + parts, np.int64)
    column = np.repeat(np.arange(len(counts)), counts)
    met = np.argwhere(examined[:, column] & (link > 0)[:, None]).tolist()
    names = [(shapes.names[k], scene.names[column[j]]) for k, j in met]
    names += [(shapes.names[k], shapes.names[i]) for k, i, _ in between_links]
    left = {(shapes.names[k], "scene"): STILL for k in np.flatnonzero(link == 0) if scene.names}
    hulls = _find_hulls(shapes, scene)
    left |= _find_still_contacts(robot, scene, kinds, column, hulls)
    left |= {(shapes.names[k], scene.names[j]): ALLOWED for k, j in np.argwhere(~examined).tolist() if link[k]}
    left_out = (*((*pair, why) for pair, why in left.items()), *shapes.left_out)
    bodies = np.array([(k, *kinds[j]) for k, j in met] + between_links, np.int64).reshape(-1, 3)
    return Pairs(bodies, tuple(names), left_out, hulls)


def _find_hulls(shapes: Shapes, scene: Scene) -> Hulls:
    """Return the hulls of an arm and of the objects around it; none for an arm without hulls."""
    if not shapes.hulls:
        return pack_hulls([], np.zeros(7, np.int64))
    pose, half, a, b, radius, _planes, solids = scene.arrays
    boxes = [(2.0 * CORNERS * h) @ T[:3, :3].T + T[:3, 3] for T, h in zip(pose, half, strict=True)]
    found = {BOX: [list_hulls([Hull(corners, 0.0)]) for corners in boxes]}
    found[ROUND] = [list_hulls([Hull(np.array(row[:2]), row[2])]) for row in zip(a, b, radius, strict=True)]
    found[CYLINDER] = [
        list_hulls([enclose_disc(row[16], 2.0 * row[17])[0].hulls[0].transform(row[:16].reshape(4, 4))])
        for row in solids[: len(scene.cylinders)]
    ]
    found[MESH] = [list_hulls([Hull(corners, 0.0)]) for corners in scene.meshes]
    found[CLOUD] = [list_balls(part, r) for points, r in scene.clouds for part in divide_cloud(points)]
    own, kinds = shapes.list_bodies(), np.zeros(7, np.int64)
    kinds[list(found)] = len(own) + np.append(0, np.cumsum([len(of) for of in found.values()]))[:-1]
    kinds[CLOUD] = kinds[MESH]  # parts of clouds are numbered after the meshes
    return pack_hulls([*own, *((0, one) for of in found.values() for one in of)], kinds)


def _find_still_contacts(
    robot: Robot, scene: Scene, kinds: list[tuple[int, int]], column: Indices, hulls: Hulls
) -> dict[tuple[str, str], str]:
    """Return the names of shapes that the arm does not move, such as those of a held arm, and of objects that they touch."""
    assert robot.shapes is not None
    shapes, examined, found = robot.shapes, scene.pair_mask(robot), dict[tuple[str, str], str]()
    room, which, at = np.empty(1), np.empty(1, np.int64), robot.spread(robot.limits.middle[None].copy())
    for k, j in np.argwhere(examined & (shapes.capsules[0] == 0)[:, None]).tolist():
        bodies = np.array([(k, *kinds[i]) for i in np.flatnonzero(column == j)], np.int64)
        rooms_batch(robot.axes.chain, (shapes.capsules, scene.arrays, bodies, hulls), at, 0.0, room, which)
        if room[0] <= 0.0 and shapes.names[k] != robot.link_names[0]:  # a base stands on something
            found[shapes.names[k], scene.names[j]] = TOUCHING
    return found


def scene_for(robot: Robot, scene: Scene | None, arms: Iterable[Robot]) -> Scene | None:
    """Return the scene for one of several arms, without the allowed pairs of links that only another arm has."""
    if scene is None:
        return None
    own, *others = ({*arm.link_names, *(arm.shapes.names if arm.shapes else ())} for arm in (robot, *arms))
    missing = set().union(*others, [PAYLOAD] if any(arm.payload is not None for arm in arms) else []) - own
    allow = tuple(pair for pair in scene.allow if pair[0] not in missing)
    return scene if allow == scene.allow else replace(scene, allow=allow)


def check_scene(robot: Robot, scene: Scene | None) -> None:
    """Check that collisions of an arm with a scene can be checked."""
    from optik.scene import Scene

    if scene is None:
        return
    check_kind(scene, "scene", Scene, "a Scene, such as optik.Scene.load(file), or Scene() for the arm alone")
    find_pairs(robot, scene)


class Contact(NamedTuple):
    """The pair of shapes with the least room at a configuration: room [m], distance [m] and names.

    The distance is below 0 if they overlap. The room is the distance, for a pair with the scene less the margin.
    """

    room: float
    distance: float
    pair: tuple[str, str]


def bodies_of(robot: Robot, scene: Scene) -> Bodies:
    """Return the shapes of an arm and a scene, and the pairs that are checked, as arguments of kernels."""
    pairs = find_pairs(robot, scene)
    assert robot.shapes is not None
    return robot.shapes.capsules, scene.arrays, pairs.bodies, pairs.hulls


def find_nearest_pairs(robot: Robot, scene: Scene, q: ArrayLike) -> tuple[Array, Indices]:
    """Return the least room of an arm at configurations (k,) [m], and the index of the pair (−1 for none)."""
    at = np.array(robot.spread(robot.configuration(q, batch=True)), order="C").reshape(-1, len(robot.fixed))
    room, which = np.empty(len(at)), np.empty(len(at), np.int64)
    rooms_batch(robot.axes.chain, bodies_of(robot, scene), at, scene.margin, room, which)
    return room, which


def find_clearances(robot: Robot, scene: Scene, q: ArrayLike) -> tuple[Array, Indices]:
    """Return the least distances of an arm at configurations (k, n) to a scene and between its own links.

    Returns distances (k, 2) [m], without the margin of the scene and infinite without a pair, and the indices of the pairs
    (k, 2) among those of `find_pairs`, −1 for none.
    """
    capsules, arrays, bodies, hulls = bodies_of(robot, scene)
    at = np.array(robot.spread(robot.configuration(q, batch=True)), order="C").reshape(-1, len(robot.fixed))
    distance, which = np.empty((2, len(at))), np.empty((2, len(at)), np.int64)
    for row, of in enumerate((bodies[:, 2] != SELF, bodies[:, 2] == SELF)):
        shapes = (capsules, arrays, bodies[of], hulls)
        rooms_batch(robot.axes.chain, shapes, at, 0.0, distance[row], which[row])
        which[row] = np.append(np.flatnonzero(of), -1)[which[row]]
    return distance.T, which.T


def find_contact(robot: Robot, scene: Scene, q: ArrayLike) -> Contact:
    """Return the pair of shapes with the least room at one configuration."""
    rooms, which = find_nearest_pairs(robot, scene, q)
    room, k, pairs = float(rooms[0]), int(which[0]), find_pairs(robot, scene)
    if k < 0:
        return Contact(room, room, ("", ""))
    return Contact(room, room if pairs.bodies[k, 2] == SELF else room + scene.margin, pairs.names[k])


def advise_contact(robot: Robot, scene: Scene, pair: tuple[str, str], other: str) -> str:
    """Return what to try against the contact of a pair of shapes; `other` where some sampled configuration is free of it."""
    capsules, arrays, bodies, hulls = bodies_of(robot, scene)
    of = bodies[[names == pair for names in find_pairs(robot, scene).names]]
    q = robot.spread(robot.limits.sample(np.random.default_rng(0), ADVISING_SAMPLES))
    room, which = np.empty(len(q)), np.empty(len(q), np.int64)
    rooms_batch(robot.axes.chain, (capsules, arrays, of, hulls), q, scene.margin, room, which)
    one, second = pair
    apart = f"leave out ({one!r}, {second!r}), if they cannot collide (srdf=, or shapes.with_apart)"
    remedy = apart if SELF in of[:, 2] else "this pair in scene.allow, if it may be in contact"
    if (room <= 0.0).all():
        return f"{one} and {second} are in contact in each of {len(q)} sampled configurations: {remedy}"
    return f"{other}; or {remedy}" if SELF in of[:, 2] else f"{other}, or a smaller margin; or {remedy}"


# ---------------------------------------------------------------- kernels


@inlined
def read_row(x: Array, i: int) -> Triple:
    """Return a row of a matrix as a tuple: x (k, 3) [m]. Returns [m]."""
    return x[i, 0], x[i, 1], x[i, 2]


@inlined
def transform_point(frame: Array, link: int, p: Triple) -> Triple:
    """Return a point of a link in the base frame: frame (n, 4, 4) [1, m], p [m]. Returns [m]."""
    if link == 0:
        return p
    T, j = frame, link - 1
    return (
        T[j, 0, 0] * p[0] + T[j, 0, 1] * p[1] + T[j, 0, 2] * p[2] + T[j, 0, 3],
        T[j, 1, 0] * p[0] + T[j, 1, 1] * p[1] + T[j, 1, 2] * p[2] + T[j, 1, 3],
        T[j, 2, 0] * p[0] + T[j, 2, 1] * p[1] + T[j, 2, 2] * p[2] + T[j, 2, 3],
    )


@inlined
def middle_of(a: Triple, b: Triple) -> Triple:
    """Return the middle of two points."""
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])


@inlined
def length_between(a: Triple, b: Triple) -> float:
    """Return the distance of two points."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return sqrt(x * x + y * y + z * z)


@compiled
def _solid_distance(a: Triple, b: Triple, solids: Array, i: int, kind: int) -> NearestPoint:
    """Return the distance of a segment to a cylinder, a mesh or a part of a cloud."""
    if kind == CYLINDER:
        row = solids[i]
        return segment_cylinder(a, b, row[:16].reshape((4, 4)), row[16:])
    if kind == CLOUD:
        return segment_cloud(a, b, solids, i)
    head = solids[solids.shape[0] - 1 - i]
    corners, faces = solids[int(head[0]) : int(head[1])], solids[int(head[2]) : int(head[3])]
    return segment_mesh(a, b, corners, faces, solids[int(head[4]) : int(head[5])])


@inlined
def find_nearest(pair: tuple[int, int, int], scene: Objects, places: Array) -> NearestPoint:
    """Return the distance of a capsule's axis to the second body of a pair, without radii.

    Shapes and units: places (m, 2, 3) [m]. Returns [m].
    """
    k, i, kind = pair
    a, b = read_row(places[k], 0), read_row(places[k], 1)
    if kind == BOX:
        return segment_box(a, b, scene[0][i], scene[1][i])
    if kind == PLANE:
        return segment_plane(a, b, scene[5][i, :3], scene[5][i, 3:])
    if kind == SELF:
        return segment_segment(a, b, read_row(places[i], 0), read_row(places[i], 1))
    if kind >= CYLINDER:
        return _solid_distance(a, b, scene[6], i, kind)
    return segment_segment(a, b, read_row(scene[2], i), read_row(scene[3], i))


@compiled
def _bound_solid(middle: Triple, solids: Array, i: int, kind: int) -> float:
    """Return a lower bound on the distance of a point from a cylinder, a mesh or a part of a cloud."""
    if kind == CYLINDER:
        x, y, z = middle[0] - solids[i, 3], middle[1] - solids[i, 7], middle[2] - solids[i, 11]
        u = solids[i, 0] * x + solids[i, 4] * y + solids[i, 8] * z
        v = solids[i, 1] * x + solids[i, 5] * y + solids[i, 9] * z
        w = max(abs(solids[i, 2] * x + solids[i, 6] * y + solids[i, 10] * z) - solids[i, 17], 0.0)
        out = max(sqrt(u * u + v * v) - solids[i, 16], 0.0)
        return sqrt(out * out + w * w)
    last = solids.shape[0] - 1 - i
    if kind == CLOUD:
        x = max(solids[last, 2] - middle[0], middle[0] - solids[last, 5], 0.0)
        y = max(solids[last, 3] - middle[1], middle[1] - solids[last, 6], 0.0)
        z = max(solids[last, 4] - middle[2], middle[2] - solids[last, 7], 0.0)
        return sqrt(x * x + y * y + z * z) - float(solids[last, 8])
    return length_between(middle, (solids[last, 6], solids[last, 7], solids[last, 8])) - float(solids[last, 9])


@inlined
def _bound_body(middle: Triple, half: float, kind: int, i: int, scene: Objects, spheres: Array) -> float:
    """Return a lower bound on the distance of an axis to the second body of a pair but solids, from spheres around axes."""
    if kind == BOX:
        T, edges = scene[0], scene[1]
        x, y, z = middle[0] - T[i, 0, 3], middle[1] - T[i, 1, 3], middle[2] - T[i, 2, 3]
        u = max(abs(T[i, 0, 0] * x + T[i, 1, 0] * y + T[i, 2, 0] * z) - edges[i, 0], 0.0)
        v = max(abs(T[i, 0, 1] * x + T[i, 1, 1] * y + T[i, 2, 1] * z) - edges[i, 1], 0.0)
        w = max(abs(T[i, 0, 2] * x + T[i, 1, 2] * y + T[i, 2, 2] * z) - edges[i, 2], 0.0)
        return sqrt(u * u + v * v + w * w) - half
    if kind == PLANE:
        plane = scene[5]
        x, y, z = middle[0] - plane[i, 0], middle[1] - plane[i, 1], middle[2] - plane[i, 2]
        return float(x * plane[i, 3] + y * plane[i, 4] + z * plane[i, 5] - half)
    if kind == SELF:
        return float(length_between(middle, read_row(spheres, i)) - half - spheres[i, 3])
    c, d = read_row(scene[2], i), read_row(scene[3], i)
    return length_between(middle, middle_of(c, d)) - half - 0.5 * length_between(c, d)


@inlined
def bound_distance(middle: Triple, half: float, kind: int, i: int, scene: Objects, spheres: Array) -> float:
    """Return a lower bound on the distance of an axis to the second body of a pair, from spheres around axes and meshes."""
    if kind >= CYLINDER:
        return _bound_solid(middle, scene[6], i, kind) - half
    return _bound_body(middle, half, kind, i, scene, spheres)


@compiled
def refine(
    pair: tuple[int, int, int], scene: Objects, hulls: Hulls, frame: Array, least: float, seed: Array
) -> tuple[float, Triple, Triple]:
    """Return a lower bound on the distance of the bodies of a pair by their hulls, less radii; see `nearest_hulls`.

    At most 0 in contact. Only a plane is no hull: the least height of the corners over it is the distance.

    Shapes and units: frame (n, 4, 4) [1, m]. Returns [m, 1, m].
    """
    k, i, kind = pair
    if kind != PLANE:
        return nearest_hulls(k, i + (hulls[3][kind] if kind != SELF else 0), hulls, frame, least, seed)
    index, heads, corners, _kinds = hulls
    n, best, point = (scene[5][i, 3], scene[5][i, 4], scene[5][i, 5]), np.inf, (0.0, 0.0, 0.0)
    for head in range(index[k, 0], index[k + 1, 0]):
        for c in range(int(heads[head, 0]), int(heads[head, 1])):
            p = transform_point(frame, index[k, 1], read_row(corners, c))
            x, y, z = p[0] - scene[5][i, 0], p[1] - scene[5][i, 1], p[2] - scene[5][i, 2]
            height = n[0] * x + n[1] * y + n[2] * z - heads[head, 6]
            if height < best:
                best, point = height, p
    return best, n, point


@compiled
def rooms_batch(chain: Chain, bodies: Bodies, q: Array, margin: float, room: Array, which: Indices) -> None:
    """Write the least room at configurations and the index of its pair.

    Shapes and units: q (k, n) [rad, m], margin [m], room (k,) [m], which (k,).
    """
    (link, a, b, radius), scene, pairs, hulls = bodies
    frame, places, spheres = np.empty((q.shape[1], 4, 4)), np.empty((link.shape[0], 2, 3)), np.empty((link.shape[0], 4))
    seed = np.full((2, 4), -1.0)
    for k in range(q.shape[0]):
        kinematics.frames(chain, q[k], frame)
        for m in range(link.shape[0]):
            u, v = transform_point(frame, link[m], read_row(a, m)), transform_point(frame, link[m], read_row(b, m))
            places[m, 0, 0], places[m, 0, 1], places[m, 0, 2] = u
            places[m, 1, 0], places[m, 1, 1], places[m, 1, 2] = v
            spheres[m, 0], spheres[m, 1], spheres[m, 2] = middle_of(u, v)
            spheres[m, 3] = 0.5 * length_between(u, v)
        room[k], which[k] = np.inf, -1
        for p in range(pairs.shape[0]):
            m, i, kind = pairs[p, 0], pairs[p, 1], pairs[p, 2]
            thick = radius[m] + (radius[i] if kind == SELF else margin + (scene[4][i] if kind == ROUND else 0.0))
            bound = bound_distance(read_row(spheres, m), spheres[m, 3], kind, i, scene, spheres)
            if bound > 0.0 and bound - DISTANCE_ROUNDING - thick > room[k]:
                continue
            distance = find_nearest((m, i, kind), scene, places)[0] - thick
            if distance <= HULLS_FROM and hulls[0].shape[0] > 0:
                least = max(room[k] + (margin if kind != SELF else 0.0), 0.0) + DISTANCE_ROUNDING
                finer = refine((m, i, kind), scene, hulls, frame, least, seed)[0]
                if finer > 0.0:
                    distance = max(distance, finer - (margin if kind != SELF else 0.0))
            if distance < room[k]:
                room[k], which[k] = distance, p
