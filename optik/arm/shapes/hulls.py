"""Hulls of the parts of a body: much closer to it than capsules, and still around it.

The part of a mesh in a capsule is cut by planes as long as this makes the hulls of both pieces much smaller than that of the
part. An extreme point of the solid between the planes is on the surface, or where three planes meet. So a hull of the cut
surface and of such points contains the solid, and not only its surface. A hull with many corners is replaced by that of a few
of them, rounded by the largest distance of the others from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from optik.arm.limits import freeze
from optik.arm.shapes.check import Capsules, check_excess
from optik.arm.shapes.enclosure import (
    CUTS,
    ENCLOSURE_ROUNDING,
    SPACING,
    Capsule,
    Hull,
    Part,
    distance_to_segment,
    enclose_cylinder,
    enclose_parts,
    find_axes,
    sample_points,
)
from optik.arm.shapes.hull_distance import Hulls, distances_from_hull
from optik.check import check_number, format_value, real_array
from optik.errors import InvalidInput
from optik.types import Array, Flags, Indices

MOST_CORNERS = 96
"""Most corners of a hull: the time of a distance grows with their number."""
ROUNDED = 5e-4
"""Rounding radius [m] from which no more corners are added."""
MOST_HULLS = 8
"""Most hulls of the part of a mesh in one capsule."""
WORTH_HALVING = 0.03
"""A part is cut if this reduces the volume of its hulls by at least this fraction of the volume of the body's hulls."""
CHOOSING_TRIANGLES = 300
"""Number of triangles of a larger part from which its cut is chosen."""
RING = 32
"""Corners around each end of the hull of a cylinder."""
PARALLEL = 1e-9
"""Determinant of three normals up to which their planes have no common point: two of them have the same axis."""
MET = 1e-6
"""Largest rounding error of a common point of three planes [m]."""
AT_ONCE = 16
"""Number of points whose distances from a hull are computed together."""


def enclose_body(triangles: Array) -> list[Capsule]:
    """Enclose a mesh by capsules with hulls."""
    tree = sample_points(triangles)
    capsules, parts = enclose_parts(triangles, tree)
    whole = find_hull(triangles.reshape(-1, 3))
    pieces = [_cut(part, (whole, c)) for part, c in zip(parts, capsules, strict=True)]
    hulls = [[round_hull(piece.points) for piece in of] for of in pieces]
    every = [hull for of in hulls for hull in of]
    measured = iter(_measure(every, tree))
    return [c._replace(hulls=tuple(next(measured) for _ in of)) for c, of in zip(capsules, hulls, strict=True)]


def enclose_disc(radius: float, length: float) -> list[Capsule]:
    """Enclose a cylinder about the z axis by a capsule with a hull."""
    angle = np.arange(RING) * 2.0 * np.pi / RING
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(RING, 0.5 * length)])
    rounding = radius * float(1.0 - np.cos(np.pi / RING)) + ENCLOSURE_ROUNDING
    hull = Hull(np.concatenate([ring, ring * (1.0, 1.0, -1.0)]), rounding, 2.0 * rounding)
    return [enclose_cylinder(radius, length)._replace(hulls=(hull,))]


class Solid(NamedTuple):
    """Convex hull of points: its corners (v, 3), triangles (t, 3, 3), planes (f, 4) and volume; no planes if it is flat."""

    points: Array
    triangles: Array
    planes: Array
    volume: float


def find_hull(points: Array) -> Solid:
    """Return the convex hull of points (k, 3)."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return Solid(np.unique(points, axis=0), np.zeros((0, 3, 3)), np.zeros((0, 4)), 0.0)
    planes = hull.equations * (1.0, 1.0, 1.0, -1.0)
    return Solid(points[hull.vertices], points[hull.simplices], planes, float(hull.volume))


def is_behind(points: Array, planes: Array, slack: float) -> Flags:
    """Return which points (..., 3) are behind all planes, or at most so far in front of one."""
    return np.asarray((points @ planes[:, :3].T <= planes[:, 3] + slack).all(axis=-1))


def round_hull(points: Array) -> Hull:
    """Return a hull of at most `MOST_CORNERS` of some points, rounded so that it contains all of them."""
    if len(points) <= MOST_CORNERS:
        return Hull(points, 0.0)
    chosen = np.unique([f(points[:, k]) for k in range(3) for f in (np.argmin, np.argmax)]).tolist()
    far, away = np.full(len(points), np.inf), np.empty(AT_ONCE)
    while True:
        worst = np.argsort(-far)[
            :AT_ONCE
        ]  # distances from smaller hulls are upper bounds: only the largest are renewed
        distances_from_hull(points[chosen], points[worst], away[: len(worst)])
        far[worst] = away[: len(worst)]
        if far[best := int(worst[np.argmax(far[worst])])] < far.max():
            continue
        if far[best] <= ROUNDED or len(chosen) >= MOST_CORNERS:
            return Hull(points[chosen], float(far[best]) + ENCLOSURE_ROUNDING)
        chosen.append(best)


def _hull_of(part: Part, around: tuple[Solid, Capsule]) -> Solid:
    """Return the hull of the solid in a part: of its surface, and of the points where three planes meet inside the solid.

    around: the hull of the body, and the capsule of the part. Both contain such points.
    """
    whole, capsule = around
    points = [part.triangles.reshape(-1, 3)]
    for three in combinations(part.planes, 3):
        normals = np.array(three)[:, :3]
        if abs(np.linalg.det(normals)) > PARALLEL:
            x = np.linalg.solve(normals, np.array(three)[:, 3])
            near = is_behind(x, part.planes, MET) and is_behind(x, whole.planes, MET)
            if near and distance_to_segment(x[None], capsule.a, capsule.b)[0] <= capsule.radius:
                points.append(x[None])
    return find_hull(np.concatenate(points))


def _cut(part: Part, around: tuple[Solid, Capsule]) -> list[Solid]:
    """Cut the part of a mesh by planes, the piece first whose hulls become smaller by the most; return the hulls."""
    pieces = [(part, _hull_of(part, around))]
    halves = [_halve(*pieces[0], around)]
    least = WORTH_HALVING * pieces[0][1].volume
    while len(pieces) < MOST_HULLS:
        rows = zip(pieces, halves, strict=True)
        gains = [hull.volume - sum(half.volume for _, half in both) if both else 0.0 for (_, hull), both in rows]
        best = int(np.argmax(gains))
        if gains[best] <= least:
            break
        both = halves[best]
        pieces[best : best + 1] = both
        halves[best : best + 1] = [_halve(*piece, around) for piece in both]
    return [hull for _, hull in pieces]


def _halve(part: Part, hull: Solid, around: tuple[Solid, Capsule]) -> list[tuple[Part, Solid]]:
    """Return both pieces of a part, with their hulls, by the cut of some that makes the hulls smallest; none if none helps."""
    few = part._replace(triangles=part.triangles[:: 1 + len(part.triangles) // CHOOSING_TRIANGLES])
    least, best = hull.volume, list[tuple[Array, list[float]]]()
    for u in find_axes(hull.points):
        low, high = float((hull.points @ u).min()), float((hull.points @ u).max())
        for share in CUTS:
            cut = u, [low + share * (high - low)]
            pieces = few.cut(*cut)
            left = sum(_hull_of(piece, around).volume for piece in pieces) if len(pieces) == 2 else np.inf
            if left < least:
                least, best = left, [cut]
    pieces = part.cut(*best[0]) if best else []
    return [(piece, _hull_of(piece, around)) for piece in pieces] if len(pieces) == 2 else []


def _measure(hulls: list[Hull], tree: Any) -> list[Hull]:
    """Return the hulls of a body with a bound of the distance of their surfaces from the points of the body.

    Triangles cover the surface that is outside of the other hulls, but for gaps narrower than the spacing of the points. No
    point of a triangle is farther from the body than its middle is, plus its largest distance from the middle. The bound is the
    largest such sum; triangles that may contain the farthest point are divided.
    """
    solids = [find_hull(hull.corners) for hull in hulls]
    step = float(np.ptp(tree.data, axis=0).max()) / SPACING
    thick = 2.0 * max(hull.radius for hull in hulls) + MET
    found = []
    for k, hull in enumerate(hulls):
        others = [solid.planes for i, solid in enumerate(solids) if i != k and len(solid.planes)]
        triangles, bound = solids[k].triangles, 0.0
        while len(triangles):
            middle = triangles.mean(axis=1)
            extent = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
            points = np.concatenate([triangles, middle[:, None]], axis=1)
            inside = np.array([is_behind(points, planes, thick) for planes in others]).reshape(-1, len(points), 4)
            within: Flags = np.any(inside, axis=0)
            kept: Flags = ~(np.all(inside, axis=2).any(axis=0) | ((extent < step) & np.all(within, axis=1)))
            triangles, middle, extent, within = triangles[kept], middle[kept], extent[kept], within[kept]
            distance = np.asarray(tree.query(middle)[0])
            least = max(bound, float(distance[~within[:, 3]].max(initial=0.0)))
            open_ = (distance + extent > least + 0.2 * step) | (np.any(within, axis=1) & (extent >= step))
            bound = max(bound, float((distance + extent)[~open_].max(initial=0.0)))
            a, b, c = np.moveaxis(triangles[open_], 1, 0)
            p, q, r = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
            corners = ((a, p, r), (p, b, q), (r, q, c), (p, q, r))
            triangles = np.concatenate([np.stack(part, axis=1) for part in corners])
        found.append(hull._replace(excess=bound + hull.radius))
    return found


def list_hulls(hulls: Sequence[Hull]) -> tuple[Array, Array]:
    """Return the rows (h, 7) of the hulls of a body for `pack_hulls`, and their corners (v, 3)."""
    rows, count = [], 0
    for corners, radius, _ in hulls:
        centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        reach = float(np.linalg.norm(corners - centre, axis=1).max()) + radius
        rows.append([count, count + len(corners), *centre, reach, radius])
        count += len(corners)
    return np.array(rows).reshape(-1, 7), np.concatenate([np.zeros((0, 3)), *(hull.corners for hull in hulls)])


def list_balls(centres: Array, radius: float) -> tuple[Array, Array]:
    """Return the rows (h, 7) of balls around points (h, 3), as of hulls, and the points."""
    first = np.arange(len(centres))
    return np.column_stack([first, first + 1, centres, np.full((len(centres), 2), radius)]), centres


def pack_hulls(bodies: Iterable[tuple[int, tuple[Array, Array]]], kinds: Indices) -> Hulls:
    """Return bodies, each with the number of its link, as kernels take them; the last argument is the last array of these."""
    index, heads, corners, total, count = [], [np.zeros((0, 7))], [np.zeros((0, 3))], 0, 0
    for link, (rows, points) in bodies:
        index.append((total, link))
        heads.append(rows + np.array([count, count, 0.0, 0.0, 0.0, 0.0, 0.0]))
        corners.append(points)
        total, count = total + len(rows), count + len(points)
    if not index:
        return np.zeros((0, 2), np.int64), heads[0], corners[0], kinds
    return np.array([*index, (total, 0)], np.int64), np.concatenate(heads), np.concatenate(corners), kinds


def check_hulls(value: Any, capsules: Capsules) -> tuple[tuple[Hull, ...], ...]:
    """Check the hulls of each capsule, whose corners must be inside of it."""
    if not isinstance(value, list | tuple) or len(value) not in (0, len(capsules[0])):
        raise InvalidInput("shapes.hulls", format_value(value), "for each capsule a list of hulls")
    rows = enumerate(zip(value, *capsules[1:], strict=True) if value else ())
    return tuple(tuple(_check_hull(hull, f"shapes.hulls[{k}]", *row) for hull in of) for k, (of, *row) in rows)


def _check_hull(value: Any, where: str, a: Array, b: Array, radius: float) -> Hull:
    """Check a hull in the capsule between two points."""
    if not isinstance(value, list | tuple) or len(value) not in (2, 3):
        raise InvalidInput(where, format_value(value), "(corners, radius, excess)")
    corners = freeze(real_array(value[0], where, "corners (v, 3)"), where)
    if corners.ndim != 2 or corners.shape[1:] != (3,) or not len(corners):
        raise InvalidInput(where, f"an array of shape {corners.shape}", "corners (v, 3)")
    if not distance_to_segment(corners, a, b).max() <= radius + 2.0 * ENCLOSURE_ROUNDING:
        raise InvalidInput(where, "a corner outside of its capsule", "corners inside of it")
    excess = np.nan if len(value) == 2 or value[2] is None else float(check_excess(value[2], 1, where)[0])
    return Hull(corners, check_number(value[1], where, "a radius", least=0.0), excess)
