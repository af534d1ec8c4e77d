"""Capsules that enclose a mesh, or links beside a chain at every value of their joints, with a proved excess.

A capsule is convex, so it encloses a triangle if it encloses its corners. A mesh that one capsule encloses badly is cut by
planes, and each part gets its own capsule. The cut face of a solid lies in the convex hull of its edge, which is part of the
cut surface, so the capsules enclose the solid and not only its surface. This needs cuts along at most two directions.

The excess of a capsule is a proved bound of the distance of its surface from the enclosed mesh. Cells along the meridian and
around the axis cover the surface. The distance of any point of a cell from the mesh is at most that of the cell's centre plus
half the cell's extent. The bound is the largest such sum; cells that may contain the farthest point are divided. Distances are
measured to sampled points of the mesh, which can only make them larger.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np

from optik import se3
from optik.arm.shapes.check import LONGEST_LINK, check_length, check_point
from optik.check import format_value
from optik.errors import InvalidInput
from optik.types import Array, Flags

# ---------------- capsules that enclose a mesh


SPACING = 60
"""Number of sampled points of a mesh along its size."""
MOST_POINTS = 200_000
"""Most points on a mesh: with fewer than `SPACING` requires, the bound is larger, never too small."""
EXCESS_STEP = 5e-4
"""Accuracy of the bound [m]."""
UNEQUAL = np.array([0.4391, 0.7127, 0.5469])
"""A direction along which different points of a mesh have different coordinates, or one of them is left out."""
MOST_OPEN_CELLS = 100_000
"""Most cells that are divided: beyond it, the bound is less accurate."""


CELLS = 16
"""Initial number of cells along the meridian of a capsule and around its axis."""


class Part(NamedTuple):
    """The triangles (k, 3, 3) of a mesh [m] behind some planes (p, 4), each the unit normal n and the largest n·x [1, m]."""

    triangles: Array
    planes: Array

    def cut(self, normal: Array, offsets: list[float]) -> list[Part]:
        """Cut the part by parallel planes; empty pieces are dropped."""
        below = [np.append(normal, offset) for offset in offsets]
        planes = [
            np.array([*below[k : k + 1], *(-one for one in below[max(k - 1, 0) : k])]) for k in range(len(below) + 1)
        ]
        pieces = zip(_slabs(self.triangles, normal, offsets), planes, strict=True)
        return [Part(piece, np.concatenate([self.planes, new])) for piece, new in pieces if len(piece)]


class Hull(NamedTuple):
    """A convex hull around a part of a body: all points within a radius [m] of the hull of corners (v, 3) [m].

    The excess is a bound of the distance of its surface from the body [m], outside of the other hulls of the body.
    """

    corners: Array
    radius: float
    excess: float = np.nan

    def transform(self, T: Array) -> Hull:
        """Return the hull in another frame."""
        return self._replace(corners=self.corners @ T[:3, :3].T + T[:3, 3])


class Capsule(NamedTuple):
    """A capsule around a part of a mesh, and hulls around the same part; no hulls if it is all that is known."""

    a: Array
    b: Array
    radius: float
    excess: float = np.nan
    hulls: tuple[Hull, ...] = ()

    def transform(self, T: Array) -> Capsule:
        """Return the capsule and its hulls in another frame."""
        a, b = T[:3, :3] @ self.a + T[:3, 3], T[:3, :3] @ self.b + T[:3, 3]
        return self._replace(a=a, b=b, hulls=tuple(hull.transform(T) for hull in self.hulls))


def complete_frame(u: Array) -> tuple[Array, Array]:
    """Return two unit vectors that form an orthonormal frame with a unit vector."""
    x, y, z = u.tolist()
    least = int(np.argmin(np.abs(u)))
    v = np.array([(0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)][least])
    v /= np.sqrt(v @ v)
    a, b, c = v.tolist()
    return v, np.array([y * c - z * b, z * a - x * c, x * b - y * a])


def distance_to_segment(points: Array, a: Array, b: Array) -> Array:
    """Return the distances of points from a segment."""
    d = b - a
    length2 = float(d @ d)
    t = np.clip((points - a) @ d / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - (a + t[:, None] * d), axis=1))


def sample_points(triangles: Array) -> Any:
    """Return a k-d tree of points on triangles, dense enough for distances to the mesh."""
    from scipy.spatial import cKDTree

    size = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    points, todo = [triangles.reshape(-1, 3)], triangles
    count = len(points[0])
    while len(todo):
        edges = np.linalg.norm(todo - np.roll(todo, -1, axis=1), axis=2)
        todo = todo[edges.max(axis=1) > size / SPACING]
        count += len(todo)
        if count > MOST_POINTS or not len(todo):
            break
        longest = np.argmax(np.linalg.norm(todo - np.roll(todo, -1, axis=1), axis=2), axis=1)
        rows, order = np.arange(len(todo))[:, None], (longest[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(todo[rows, order], 1, 0)
        middle = 0.5 * (a + b)
        points.append(middle)
        todo = np.concatenate((np.stack((a, middle, c), axis=1), np.stack((middle, b, c), axis=1)))
    every = np.concatenate(points)
    return cKDTree(every[np.unique(every @ UNEQUAL, return_index=True)[1]])


def measure_excess(capsules: list[Capsule], tree: Any) -> list[Capsule]:
    """Return the capsules of a mesh with the bounds of their excess."""
    others = [capsules[:i] + capsules[i + 1 :] for i in range(len(capsules))]
    return [c._replace(excess=bound_excess(c, rest, tree)) for c, rest in zip(capsules, others, strict=True)]


def bound_excess(capsule: Capsule, others: list[Capsule], tree: Any, *, coarse: bool = False) -> float:
    """Bound the distance of a capsule's surface outside of the other capsules from the points of the mesh."""
    meridian = float(np.linalg.norm(capsule.b - capsule.a)) + np.pi * capsule.radius
    steps = (np.arange(CELLS) + 0.5) / CELLS
    s, phi = (grid.ravel() for grid in np.meshgrid(steps * meridian, steps * 2.0 * np.pi))
    ds, dphi, bound = meridian / CELLS, 2.0 * np.pi / CELLS, 0.0
    while len(s):
        place, across = _surface_points(capsule, s, phi)
        extent = 0.5 * ds + 0.5 * dphi * np.minimum(across + 0.5 * ds, capsule.radius)
        outside = np.ones(len(s), dtype=bool)
        for other in others:
            outside &= distance_to_segment(place, other.a, other.b) > other.radius - (0.0 if coarse else extent)
        s, phi, place, extent = s[outside], phi[outside], place[outside], extent[outside]
        distance = np.asarray(tree.query(place)[0]) if len(s) else np.zeros(0)
        if coarse:
            return float(distance.max(initial=0.0))
        open_ = distance + extent > max(float(distance.max(initial=0.0)), bound) + EXCESS_STEP
        if np.count_nonzero(open_) > MOST_OPEN_CELLS:
            open_[:] = False
        bound = max(bound, float((distance + extent)[~open_].max(initial=0.0)))
        ds, dphi = 0.5 * ds, 0.5 * dphi
        s = np.concatenate([s[open_] + 0.5 * i * ds for i in (-1, -1, 1, 1)])
        phi = np.concatenate([phi[open_] + 0.5 * i * dphi for i in (-1, 1, -1, 1)])
    return bound


def _surface_points(capsule: Capsule, s: Array, phi: Array) -> tuple[Array, Array]:
    """Return points of a capsule's surface, by meridian length and angle, and their distances from the axis."""
    r, d = capsule.radius, capsule.b - capsule.a
    length = float(np.linalg.norm(d))
    u = d / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    v, w = complete_frame(u)
    cap = 0.5 * np.pi * r
    angle = np.where(s < cap, s, np.where(s > cap + length, s - length, cap)) / r
    along = np.clip(s - cap, 0.0, length) - r * np.cos(angle)
    across = r * np.sin(angle)
    around = np.cos(phi)[:, None] * v + np.sin(phi)[:, None] * w
    return capsule.a + along[:, None] * u + across[:, None] * around, across


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
    return enclose_parts(triangles, sample_points(triangles), most, excess)[0]


def enclose_parts(
    triangles: Array, tree: Any, most: int = MOST_OF_ONE, excess: float = WELL_ENCLOSED
) -> tuple[list[Capsule], list[Part]]:
    """Return the capsules of a mesh, of which `sample_points` is known, and the part of the mesh in each of them."""
    parts, found = [Part(triangles, np.empty((0, 4)))], [fit_capsule(triangles)]
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
    return found, parts


def _divide(
    parts: list[Part], found: list[Capsule], i: int, tree: Any, most: int
) -> tuple[list[Part], list[Capsule]] | None:
    """Return parts and capsules with part i cut into at most `most`, or None if excess and size gain too little."""
    others = found[:i] + found[i + 1 :]
    pieces = _cut(parts[i], others, tree, most)
    capsules = [fit_capsule(piece.triangles) for piece in pieces]
    if not capsules:
        return None
    every = measure_excess([*found[:i], *capsules, *found[i + 1 :]], tree)
    worst = max(c.excess for c in every[i : i + len(capsules)])
    if worst * _size(capsules) > WORTH_A_CUT * found[i].excess * _size([found[i]]):
        return None
    return [*parts[:i], *pieces, *parts[i + 1 :]], every


def _rate(capsules: list[Capsule], others: list[Capsule], tree: Any, enough: float) -> float:
    """Return the product of the largest excess of some capsules of a mesh and their size, or a part of it from `enough` on."""
    size, worst = _size(capsules), 0.0
    for k, c in enumerate(capsules):
        worst = max(worst, bound_excess(c, [*others, *capsules[:k], *capsules[k + 1 :]], tree, coarse=True))
        if worst * size >= enough:
            break
    return worst * size


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
    for u in find_axes(points):
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


def _cut(part: Part, others: list[Capsule], tree: Any, most: int) -> list[Part]:
    """Cut a part across an axis into two or three, with the least excess of the cuts tried; no parts if none helps."""
    triangles = part.triangles
    few = triangles[:: 1 + len(triangles) // FEW_TRIANGLES]
    points = triangles.reshape(-1, 3)
    best: tuple[Array, list[float]] | None = None
    least = np.inf
    for u in find_axes(points):
        low, high = float((points @ u).min()), float((points @ u).max())
        offsets = [low + share * (high - low) for share in CUTS]
        slabs = [_hull(slab.reshape(-1, 3)) for slab in _slabs(few, u, offsets)]
        fits: dict[tuple[int, int], Capsule] = {}
        for cuts in (c for count in range(1, min(most, 3)) for c in combinations(range(len(CUTS)), count)):
            spans = [(k + 1, m + 1) for k, m in pairwise((-1, *cuts, len(CUTS)))]
            if min(sum(map(len, slabs[k:m])) for k, m in spans) == 0:
                continue
            for k, m in spans:
                fits[k, m] = fits.get((k, m)) or fit_roughly(np.concatenate(slabs[k:m]))
            enough = (1.0 if len(cuts) == 1 else WORTH_A_CUT) * least  # a third capsule must reduce it more
            worst = _rate([fits[span] for span in spans], others, tree, enough)
            if worst < enough:
                best, least = (u, [offsets[k] for k in cuts]), worst
    return part.cut(*best) if best is not None else []


def _slabs(triangles: Array, normal: Array, offsets: list[float]) -> list[Array]:
    """Split a mesh by parallel planes."""
    pieces = []
    for offset in offsets:
        below, triangles = split_mesh(triangles, normal, offset)
        pieces.append(below)
    return [*pieces, triangles]


def find_axes(points: Array) -> Array:
    """Return the axes of the frame and the principal axes of points that differ from them, as rows."""
    offsets = points - points.mean(axis=0)
    principal = np.linalg.eigh(offsets.T @ offsets)[1].T
    return np.vstack((np.eye(3), principal[np.abs(principal).max(axis=1) < SAME_AXIS]))


def fit_roughly(points: Array, wider: float = 0.2) -> Capsule:
    """Return the smallest capsule about a few axes, its radius enlarged by the factor 1 + wider²."""
    corners = _hull(points)
    a, b, radius = min(
        (_fit_about_line(corners, *start, wider) for start in _starts(corners)), key=lambda c: _volume(*c)
    )
    return Capsule(a, b, radius * (1.0 + ENCLOSURE_ROUNDING) + ENCLOSURE_ROUNDING)


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
    capsules: list[Capsule] = []
    for i, one in enumerate(objects):
        where = f"{name}.shapes[{i}]"
        if isinstance(one, Capsule):
            capsules.append(one)
            continue
        if not isinstance(one, list | tuple) or len(one) not in (2, 3):
            raise InvalidInput(where, format_value(one), expected)
        if len(one) == 2 and np.ndim(one[1]) == 1:
            capsules += _box(one[0], one[1], where)
        else:
            ends = [check_point(end, where, LONGEST_LINK) for end in one[:-1]]
            capsules.append(Capsule(ends[0], ends[-1], check_length(one[-1], f"{where}: radius", LONGEST_LINK), 0.0))
    if not capsules:
        raise InvalidInput(f"{name}.shapes", "none", expected)
    return [c.transform(place) for c in capsules]


def _box(pose: Any, edges: Any, where: str) -> list[Capsule]:
    lengths = check_point(edges, f"{where}: edges", LONGEST_LINK)
    if (lengths <= 0.0).any():
        raise InvalidInput(f"{where}: edges", format_value(edges), "three full edge lengths above 0")
    T = se3.check_pose(pose, f"{where}: T")
    return [c.transform(T) for c in enclose_mesh(box_triangles(lengths))]


# ---------------- capsules


WELL_SWEPT = 0.01
"""Increase of the radius [m] below which a range is not halved further."""
MOST_SWEPT = 8
"""Most capsules of one moving link, if it has fewer itself: the time of a certificate grows with their number."""
LONGEST_ARC = 0.5
"""Longest arc between corners [rad]: a corner lies 3 % outside of its arc."""
TURN_ABOUT_AXIS = 1.5 * np.pi
"""Angle [rad] from which a capsule about the axis encloses a turn."""
MOST_SWEPT_POINTS = 100
"""Most points that contain the ends of an axis: more of them are enclosed by a capsule."""


class SweepStep(NamedTuple):
    """A joint between a link and the arm: its pose, its axis, and its value factor · (value of a driver) + offset."""

    T: Array
    slides: bool
    axis: Array
    driver: int
    factor: float
    offset: float


def sweep_capsules(capsules: Sequence[Capsule], steps: Sequence[SweepStep], ranges: Array) -> list[Capsule]:
    """Enclose capsules of a link for all values of the drivers.

    steps: from the link to the arm. ranges (d, 2): lower and upper value of each driver [rad, m].
    """
    parts = [(ranges, _sweep_all(capsules, steps, ranges))]
    while (len(parts) + 1) * len(capsules) <= MOST_SWEPT:
        growth = [_measure_growth(capsules, swept) for _, swept in parts]
        i = int(np.argmax(growth))
        if growth[i] <= WELL_SWEPT:
            break
        part = parts[i][0]
        halves = [
            [(half, _sweep_all(capsules, steps, half)) for half in _halve(part, driver)]
            for driver, (low, high) in enumerate(part.tolist())
            if np.isfinite(high - low) and high > low
        ]
        if not halves:
            break
        worst = [max(_measure_growth(capsules, swept) for _, swept in pair) for pair in halves]
        parts[i : i + 1] = halves[int(np.argmin(worst))]
    return [c for _, swept in parts for c in swept]


def _halve(ranges: Array, driver: int) -> tuple[Array, Array]:
    """Return the ranges with that of one driver halved."""
    lower, upper = ranges.copy(), ranges.copy()
    lower[driver, 1] = upper[driver, 0] = ranges[driver].mean()
    return lower, upper


def _measure_growth(capsules: Sequence[Capsule], found: Sequence[Capsule]) -> float:
    """Return the largest increase of a radius."""
    return max(b.radius - a.radius for a, b in zip(capsules, found, strict=True))


def _sweep_all(capsules: Sequence[Capsule], steps: Sequence[SweepStep], ranges: Array) -> list[Capsule]:
    """Enclose each capsule by one for all values of the drivers."""
    return [_sweep(c, steps, ranges) for c in capsules]


def _sweep(c: Capsule, steps: Sequence[SweepStep], ranges: Array) -> Capsule:
    """Enclose a capsule by one for all values of the drivers."""
    points, radius, excess, fixed = np.array([c.a, c.b]), c.radius, c.excess, c
    for step in steps:
        low, high = (
            sorted(step.factor * ranges[step.driver] + step.offset) if step.factor else (step.offset, step.offset)
        )
        if step.slides:
            shifts = np.array([low, high]) if high > low else np.array([low])
            points = (points + (shifts[:, None] * step.axis)[:, None]).reshape(-1, 3)
        elif high - low >= TURN_ABOUT_AXIS:
            along = points @ step.axis
            radius += float(np.linalg.norm(points - along[:, None] * step.axis, axis=1).max())
            points, excess = np.array([along.min(), along.max()])[:, None] * step.axis, np.nan
        else:
            points = turn_points(points, step.axis, low, high)
        points = points @ step.T[:3, :3].T + step.T[:3, 3]
        if len(points) > MOST_SWEPT_POINTS:
            hull, excess = fit_roughly(points, 0.0), np.nan
            points, radius = np.array([hull.a, hull.b]), radius + hull.radius
        turn = np.eye(4)
        turn[:3, :3], turn[:3, 3] = (np.eye(3), low * step.axis) if step.slides else (se3.exp_so3(low * step.axis), 0.0)
        fixed = fixed.transform(step.T @ turn)
    if len(points) == 2:
        hulls = () if any(step.factor for step in steps) else fixed.hulls
        return Capsule(points[0], points[1], radius, excess, hulls)
    hull = fit_roughly(points, 0.0)
    return Capsule(hull.a, hull.b, hull.radius + radius)


def turn_points(points: Array, axis: Array, low: float, high: float) -> Array:
    """Return points whose convex hull contains points that turn about an axis between two angles."""
    if high == low:
        return points @ se3.exp_so3(low * axis).T
    count = int(np.ceil((high - low) / LONGEST_ARC))
    half = 0.5 * (high - low) / count
    along = (points @ axis)[:, None] * axis
    corners = low + half * (1.0 + 2.0 * np.arange(count))
    turns = [(low, 1.0), *((angle, 1.0 / np.cos(half)) for angle in corners.tolist()), (high, 1.0)]
    return np.concatenate([along + wider * ((points - along) @ se3.exp_so3(angle * axis).T) for angle, wider in turns])
