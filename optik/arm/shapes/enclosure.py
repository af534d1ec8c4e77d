"""Capsules that enclose a mesh, with a proved bound of their excess.

A capsule is convex, so it encloses a triangle if it encloses its corners. A mesh that one capsule encloses badly is cut by
planes, and each part gets its own capsule. The cut face of a solid lies in the convex hull of its edge, which is part of the
cut surface, so the capsules enclose the solid and not only its surface.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations
from typing import Any

import numpy as np

from optik import se3
from optik.arm.shapes.check import LONGEST_LINK, check_length, check_point
from optik.arm.shapes.excess import (
    Capsule,
    bound_excess,
    complete_frame,
    distance_to_segment,
    measure_excess,
    sample_points,
)
from optik.check import format_value
from optik.errors import InvalidInput
from optik.types import Array, Flags

ENCLOSURE_ROUNDING = 1e-9
"""Increase of every radius [m], a million times the rounding errors of positions."""

WELL_ENCLOSED = 0.03
"""Excess [m] below which a mesh is not cut further."""

MOST_OF_ONE = 3
"""Most capsules of one mesh: the time of a certificate grows with their number."""

WORTH_A_CUT = 0.9
"""A part is cut if the product of excess and size falls below this fraction of its value: more capsules cost time."""

FEW_TRIANGLES = 500
"""Number of triangles of a larger mesh from which the cuts are chosen."""

SAME_AXIS = 0.98
"""A principal axis whose cosine to an axis of the frame is above this is not tried."""

CUTS = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Positions of the planes that are tried, as fractions of the extent along an axis."""

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
"""Corners of a box with edges of length 1."""

FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of the faces of a box, each around its face."""


def enclose_mesh(triangles: Array, most: int = MOST_OF_ONE, excess: float = WELL_ENCLOSED) -> list[Capsule]:
    """Enclose a mesh by one capsule, or by several if its excess is too large."""
    tree = sample_points(triangles)
    parts, found = [triangles], [fit_capsule(triangles)]
    found = measure_excess(found, tree)
    closed: set[int] = set()
    while len(parts) < most:
        open_ = [i for i, c in enumerate(found) if c.excess > excess and id(parts[i]) not in closed]
        if not open_:
            break
        i = max(open_, key=lambda k: found[k].excess)
        better = _divide(parts, found, i, tree, most + 1 - len(parts))
        if better is None:
            closed.add(id(parts[i]))
        else:
            parts, found = better
    return found


def _divide(
    parts: list[Array], found: list[Capsule], i: int, tree: Any, most: int
) -> tuple[list[Array], list[Capsule]] | None:
    """Return parts and capsules with part i cut into at most `most`, or None if excess and size gain too little."""
    others = found[:i] + found[i + 1 :]
    pieces = _cut(parts[i], others, tree, most)
    capsules = [fit_capsule(piece) for piece in pieces]
    if not capsules:
        return None
    before = found[i].excess * _size([found[i]])
    if _largest_excess(capsules, others, tree) * _size(capsules) > WORTH_A_CUT * before:
        return None
    return [*parts[:i], *pieces, *parts[i + 1 :]], measure_excess([*found[:i], *capsules, *found[i + 1 :]], tree)


def _largest_excess(capsules: list[Capsule], others: list[Capsule], tree: Any, *, coarse: bool = False) -> float:
    """Return the largest excess of some capsules of a mesh."""
    rest = [[*others, *capsules[:k], *capsules[k + 1 :]] for k in range(len(capsules))]
    return max(bound_excess(c, r, tree, coarse=coarse) for c, r in zip(capsules, rest, strict=True))


def box_triangles(edges: Array) -> Array:
    """Return the triangles of a box about the origin."""
    corners = CORNERS * edges
    return np.array([corners[list(part)] for a, b, c, d in FACES for part in ((a, b, c), (a, c, d))])


# ---------------------------------------------------------------- one capsule


def fit_capsule(triangles: Array) -> Capsule:
    """Enclose triangles by one capsule of small volume."""
    from scipy.optimize import minimize

    points = triangles.reshape(-1, 3)
    corners = _hull(points)
    starts = sorted(_starts(corners), key=lambda start: _volume(*_fit_about_line(corners, *start)))

    best: tuple[Array, Array, float] = (*starts[0], 0.0)
    for origin, u in starts[:2]:
        v, w = complete_frame(u)
        size = float(np.ptp(corners, axis=0).max())

        def placed(x: Array, o: Array = origin, u: Array = u, v: Array = v, w: Array = w) -> tuple[Array, Array, float]:
            return o + x[0] * v + x[1] * w, u + x[2] * v + x[3] * w, x[4]

        def cost(x: Array, placed: Any = placed) -> float:
            return _volume(*_fit_about_line(corners, *placed(x)))

        steps = np.array([0.05 * size, 0.05 * size, 0.1, 0.1, 0.2])
        simplex = np.vstack((np.zeros(5), np.diag(steps)))
        result = minimize(cost, np.zeros(5), method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": 600})
        if result.fun < _volume(*_fit_about_line(corners, *best)):
            best = placed(result.x)
    a, b, _ = _fit_about_line(corners, *best)
    radius = float(distance_to_segment(points, a, b).max()) * (1.0 + ENCLOSURE_ROUNDING) + ENCLOSURE_ROUNDING
    return Capsule(a, b, radius)


def enclose_cylinder(radius: float, length: float) -> Capsule:
    """Enclose a cylinder about the z axis by a capsule about the same axis, of the least volume."""
    # With radius r the ends of the segment lie √(r² − radius²) inside the cylinder's faces; the last r gives a sphere.
    r = radius + np.linspace(0.0, 1.0, 1001) ** 2 * (np.hypot(radius, 0.5 * length) - radius)
    half = np.maximum(0.5 * length - np.sqrt(r * r - radius * radius), 0.0)
    best = int(np.argmin(r * r * (2.0 * half + 4.0 / 3.0 * r)))
    end = np.array([0.0, 0.0, half[best]])
    excess = max(r[best] - radius, half[best] + r[best] - 0.5 * length)
    return Capsule(
        -end,
        end,
        float(r[best]) * (1.0 + ENCLOSURE_ROUNDING) + ENCLOSURE_ROUNDING,
        float(excess) + 2.0 * ENCLOSURE_ROUNDING,
    )


def _hull(points: Array) -> Array:
    """Return the corners of the convex hull; all points if they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.ascontiguousarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points


def _starts(points: Array) -> list[tuple[Array, Array]]:
    """List lines through the middle of the points, along the axes of the frame and the principal axes."""
    found = []
    for u in _axes(points):
        v, w = complete_frame(u)
        middle = sum(0.5 * ((points @ x).min() + (points @ x).max()) * x for x in (u, v, w))
        found.append((np.asarray(middle), u))
    return found


def _fit_about_line(points: Array, origin: Array, direction: Array, wider: float = 0.0) -> tuple[Array, Array, float]:
    """Return the shortest capsule about a line that encloses points, its radius enlarged by the factor 1 + wider²."""
    u = direction / np.linalg.norm(direction)
    offsets = points - origin
    along = offsets @ u
    off = np.maximum((offsets * offsets).sum(axis=1) - along * along, 0.0)
    radius = float(np.sqrt(off.max())) * (1.0 + wider * wider)
    reach = np.sqrt(np.maximum(radius * radius - off, 0.0))
    first, last = float((along + reach).min()), float((along - reach).max())
    if first > last:  # a sphere on the line
        first = last = 0.5 * (first + last)
        radius = float(np.sqrt((off + (along - first) ** 2).max()))
    return origin + first * u, origin + last * u, radius


def _volume(a: Array, b: Array, radius: float) -> float:
    return float(np.pi * radius * radius * (np.linalg.norm(b - a) + 4.0 / 3.0 * radius))


# ---------------------------------------------------------------- cutting


def _size(capsules: list[Capsule]) -> float:
    """Return the cube root of the total volume [m]."""
    return float(np.cbrt(sum(_volume(c.a, c.b, c.radius) for c in capsules)))


def _cut(triangles: Array, others: list[Capsule], tree: Any, most: int) -> list[Array]:
    """Cut a mesh across an axis into two or three parts, with the least excess of the cuts tried; no parts if none helps."""
    few = triangles[:: 1 + len(triangles) // FEW_TRIANGLES]
    points = triangles.reshape(-1, 3)
    best: tuple[Array, list[float]] | None = None
    least = np.inf
    for u in _axes(points):
        low, high = float((points @ u).min()), float((points @ u).max())
        for cuts in (c for count in range(1, min(most, 3)) for c in combinations(CUTS, count)):
            offsets = [low + part * (high - low) for part in cuts]
            pieces = _slabs(few, u, offsets)
            if min(len(piece) for piece in pieces) == 0:
                continue
            capsules = [_fit_roughly(piece) for piece in pieces]
            worst = _largest_excess(capsules, others, tree, coarse=True) * _size(capsules)
            if worst < (1.0 if len(pieces) == 2 else WORTH_A_CUT) * least:  # a third capsule must reduce it more
                best, least = (u, offsets), worst
    return [piece for piece in _slabs(triangles, *best) if len(piece)] if best is not None else []


def _slabs(triangles: Array, normal: Array, offsets: list[float]) -> list[Array]:
    """Split a mesh by parallel planes."""
    pieces = []
    for offset in offsets:
        below, triangles = split_mesh(triangles, normal, offset)
        pieces.append(below)
    return [*pieces, triangles]


def _axes(points: Array) -> Array:
    """Return the axes of the frame and the principal axes of points that differ from them, as rows."""
    offsets = points - points.mean(axis=0)
    principal = np.linalg.eigh(offsets.T @ offsets)[1].T
    return np.vstack((np.eye(3), principal[np.abs(principal).max(axis=1) < SAME_AXIS]))


def _fit_roughly(triangles: Array) -> Capsule:
    """Return the smallest capsule about a few axes."""
    corners = _hull(triangles.reshape(-1, 3))
    return Capsule(
        *min((_fit_about_line(corners, *start, 0.2) for start in _starts(corners)), key=lambda c: _volume(*c))
    )


def split_mesh(triangles: Array, normal: Array, offset: float) -> tuple[Array, Array]:
    """Split triangles by a plane; return those below and above it."""
    height = triangles @ normal - offset
    up: Flags = height > 0.0
    count = up.sum(axis=1)
    sides = {False: [triangles[count == 0]], True: [triangles[count == 3]]}
    for alone in (True, False):  # triangles with one corner on one side, and two on the other
        chosen = count == (1 if alone else 2)
        if not chosen.any():
            continue
        first = np.argmax(up[chosen] == alone, axis=1)
        order = (first[:, None] + np.arange(3)) % 3
        rows = np.arange(len(order))[:, None]
        corner, h = triangles[chosen][rows, order], height[chosen][rows, order]
        a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
        p = a + (h[:, 0] / (h[:, 0] - h[:, 1]))[:, None] * (b - a)
        q = a + (h[:, 0] / (h[:, 0] - h[:, 2]))[:, None] * (c - a)
        sides[alone].append(np.stack((a, p, q), axis=1))
        sides[not alone] += [np.stack((p, b, c), axis=1), np.stack((p, c, q), axis=1)]
    return np.concatenate(sides[False]), np.concatenate(sides[True])


# ---------------------------------------------------------------- boxes, spheres and capsules


def enclose_objects(objects: Iterable[Any], name: str, place: Array) -> list[Capsule]:
    """Return the capsules that enclose boxes, spheres and capsules."""
    expected = "a list of boxes (T, edges), spheres (centre, radius) or capsules (a, b, radius)"
    if isinstance(objects, str) or not isinstance(objects, Iterable):
        raise InvalidInput(f"{name}.shapes", format_value(objects), expected)
    found: list[Capsule] = []
    for i, one in enumerate(objects):
        where = f"{name}.shapes[{i}]"
        if not isinstance(one, list | tuple) or len(one) not in (2, 3):
            raise InvalidInput(where, format_value(one), expected)
        if len(one) == 2 and np.ndim(one[1]) == 1:
            found += _box(one[0], one[1], where)
        else:
            ends = [check_point(end, where, LONGEST_LINK) for end in one[:-1]]
            found.append(Capsule(ends[0], ends[-1], check_length(one[-1], f"{where}: radius", LONGEST_LINK), 0.0))
    if not found:
        raise InvalidInput(f"{name}.shapes", "none", expected)
    return [c.transform(place) for c in found]


def _box(pose: Any, edges: Any, where: str) -> list[Capsule]:
    lengths = check_point(edges, f"{where}: edges", LONGEST_LINK)
    if (lengths <= 0.0).any():
        raise InvalidInput(f"{where}: edges", format_value(edges), "three full edge lengths above 0")
    T = se3.check_pose(pose, f"{where}: T")
    return [c.transform(T) for c in enclose_mesh(box_triangles(lengths))]
