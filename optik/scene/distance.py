"""Exact distances of a segment, the axis of a capsule, to a segment, a box, a cylinder, a plane and a convex mesh.

For a point p(s) of a segment, let w(s) be its difference from the nearest point of a convex set. |w(s)| is convex, and for a
box or another segment w is piecewise linear in s, with at most six breakpoints. So the least |w| lies on one piece, where it is
the distance of the origin to the segment between the piece's ends. For a cylinder, Newton's method between bounds finds the
zero of the slope of |w|². The error of a distance is rounding only, less than `DISTANCE_ROUNDING` for coordinates up to
`LARGEST_COORDINATE`.

Where the segment intersects a solid, the distance is minus the penetration depth: the length of the shortest translation of the
segment after which both only touch. Along a unit vector n it is h(n) − min n·p, where h(n) is the largest n·x of the solid. The
depth is the least of these values. Its n is the normal of a face, or perpendicular to the segment and normal to an edge. The
depth has a direction even where the segment passes through a thin board. A motion changes it by at most the segment's
displacement.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from optik.arm.limits import freeze
from optik.arm.shapes.hulls import reduce_simplex
from optik.check import format_value, real_array
from optik.compiled import compiled, inlined
from optik.errors import InvalidInput
from optik.kinematics import Triple
from optik.types import Array

# ---------------- exact distances of a segment


NearestPoint = tuple[float, float, Triple]
"""Least distance [m], below 0 inside a solid; the position on the first segment as a fraction from 0 to 1; and the difference
there from the nearest point of the other body (3,) [m]: the distance times the unit normal that points away from that body."""
Depth = tuple[float, float, Triple]
"""Penetration depth [m], the position on the segment as a fraction, and the unit vector along which the segment leaves."""
DISTANCE_ROUNDING = 1e-9
"""Bound of the error of a distance [m], with the rounding of poses: several hundred times 2e-16 of `LARGEST_COORDINATE`."""
LARGEST_COORDINATE = 1e4
"""Largest coordinate [m] for which `DISTANCE_ROUNDING` holds."""
CYLINDER_ERROR = 1e-12
"""Bound of the error of a distance from a cylinder, besides rounding [m]."""


@inlined
def _nearest_to_origin(u: Triple, v: Triple) -> tuple[float, float]:
    """Return the squared distance from the origin to the segment u–v, and its nearest point as a fraction from u to v."""
    x, y, z = v[0] - u[0], v[1] - u[1], v[2] - u[2]
    square = x * x + y * y + z * z
    share = 0.0
    if square > 0.0:
        share = min(max(-(u[0] * x + u[1] * y + u[2] * z) / square, 0.0), 1.0)
    x, y, z = u[0] + share * x, u[1] + share * y, u[2] + share * z
    return x * x + y * y + z * z, share


@inlined
def _difference_from_segment(p: Triple, c: Triple, d: Triple, square: float) -> Triple:
    """Return the difference of a point p from the nearest point of the segment from c along d."""
    x, y, z = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    t = 0.0
    if square > 0.0:
        t = min(max((x * d[0] + y * d[1] + z * d[2]) / square, 0.0), 1.0)
    return x - t * d[0], y - t * d[1], z - t * d[2]


@inlined
def dot(u: Triple, v: Triple) -> float:
    """Return the scalar product of two vectors (3,)."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@inlined
def _point_at(a: Triple, d: Triple, s: float) -> Triple:
    return a[0] + s * d[0], a[1] + s * d[1], a[2] + s * d[2]


@compiled
def segment_segment(a: Triple, b: Triple, c: Triple, d: Triple) -> NearestPoint:
    """Return the least distance of two segments; each may be a point: a, b [m], c, d [m]. Returns [m]."""
    # The nearest point of the second segment is one of its ends, or between them: two breakpoints. All three pieces are
    # tried, because rounding may change the order of breakpoints of nearly parallel segments.
    u = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    v = (d[0] - c[0], d[1] - c[1], d[2] - c[2])
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    slope = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    first, second = 0.0, 1.0
    if slope != 0.0:
        ahead = (a[0] - c[0]) * v[0] + (a[1] - c[1]) * v[1] + (a[2] - c[2]) * v[2]
        at, to = -ahead / slope, (square - ahead) / slope
        first, second = min(max(min(at, to), 0.0), 1.0), min(max(max(at, to), 0.0), 1.0)
    best, place = -1.0, 0.0
    low, left = 0.0, _difference_from_segment(a, c, v, square)
    for piece in range(3):
        high = first if piece == 0 else (second if piece == 1 else 1.0)
        if high > low or piece == 0:
            right = _difference_from_segment(_point_at(a, u, high), c, v, square)
            distance, share = _nearest_to_origin(left, right)
            if best < 0.0 or distance < best:
                best, place = distance, low + share * (high - low)
            low, left = high, right
    w = _difference_from_segment(_point_at(a, u, place), c, v, square)
    return sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]), place, w


@inlined
def _excess(x: float, half: float) -> float:
    """Return the signed distance of a coordinate from [−half, half]."""
    return x - half if x > half else (x + half if x < -half else 0.0)


@inlined
def _difference_from_box(a: Triple, d: Triple, half: Triple, s: float) -> Triple:
    return (_excess(a[0] + s * d[0], half[0]), _excess(a[1] + s * d[1], half[1]), _excess(a[2] + s * d[2], half[2]))


@inlined
def _to_frame(T: Array, p: Triple) -> Triple:
    """Return the coordinates of a point in the frame T."""
    x, y, z = p[0] - T[0, 3], p[1] - T[1, 3], p[2] - T[2, 3]
    return (
        T[0, 0] * x + T[1, 0] * y + T[2, 0] * z,
        T[0, 1] * x + T[1, 1] * y + T[2, 1] * z,
        T[0, 2] * x + T[1, 2] * y + T[2, 2] * z,
    )


@inlined
def _from_frame(T: Array, w: Triple) -> Triple:
    """Return the coordinates of a direction of the frame T."""
    return (
        T[0, 0] * w[0] + T[0, 1] * w[1] + T[0, 2] * w[2],
        T[1, 0] * w[0] + T[1, 1] * w[1] + T[1, 2] * w[2],
        T[2, 0] * w[0] + T[2, 1] * w[1] + T[2, 2] * w[2],
    )


@compiled
def _box_depth(p: Triple, d: Triple, half: Triple) -> Depth:
    """Return how deep the segment from p along d is in a box, in the box's frame; at most 0 if they are apart."""
    best, place, normal = np.inf, 0.0, (0.0, 0.0, 1.0)
    x, n, m = np.array(p), np.zeros(3), np.zeros(3)
    h, e = np.array(half), np.array(d)
    for k in range(3):  # the faces
        for side in (-1.0, 1.0):
            first, last = side * x[k], side * (x[k] + e[k])
            if h[k] - min(first, last) < best:
                best, place = h[k] - min(first, last), 0.0 if first <= last else 1.0
                n[:] = 0.0
                n[k] = side
                normal = (n[0], n[1], n[2])
    for k in range(3):  # the edges along axis k
        i, j = (k + 1) % 3, (k + 2) % 3
        across = sqrt(e[i] * e[i] + e[j] * e[j])
        if across > 0.0:
            n[k], n[i], n[j] = 0.0, -e[j] / across, e[i] / across
            if n[i] * x[i] + n[j] * x[j] < 0.0:
                n[i], n[j] = -n[i], -n[j]
            depth = h[i] * abs(n[i]) + h[j] * abs(n[j]) - (n[i] * x[i] + n[j] * x[j])
            if depth < best:
                m[i], m[j] = (h[i] if n[i] > 0.0 else -h[i]) - x[i], (h[j] if n[j] > 0.0 else -h[j]) - x[j]
                best, place = depth, min(max((m[i] * e[i] + m[j] * e[j]) / (across * across), 0.0), 1.0)
                normal = (n[0], n[1], n[2])
    return best, place, normal


@compiled
def _cylinder_depth(p: Triple, d: Triple, radius: float, half: float) -> Depth:
    """Return how deep the segment from p along d is in a cylinder about z, in its frame; at most 0 if they are apart."""
    q = _point_at(p, d, 1.0)
    best, place, normal = half - min(p[2], q[2]), 0.0 if p[2] <= q[2] else 1.0, (0.0, 0.0, 1.0)
    if half + max(p[2], q[2]) < best:
        best, place, normal = half + max(p[2], q[2]), 0.0 if p[2] >= q[2] else 1.0, (0.0, 0.0, -1.0)
    square, share = _nearest_to_origin((p[0], p[1], 0.0), (q[0], q[1], 0.0))  # the curved side
    length, flat = sqrt(square), sqrt(d[0] * d[0] + d[1] * d[1])
    if radius - length < best:
        best, place = radius - length, share
        if length > 0.0:
            normal = ((p[0] + share * d[0]) / length, (p[1] + share * d[1]) / length, 0.0)
        elif flat > 0.0:
            normal = (-d[1] / flat, d[0] / flat, 0.0)
        else:
            normal = (1.0, 0.0, 0.0)
    if flat == 0.0 or d[2] == 0.0:
        return best, place, normal
    # The rims, by n = c u + t v perpendicular to the segment, c² + t² = 1: u is the steepest, v is horizontal. Let U and V be
    # the segment's coordinates along them, both turned to be positive. The depth is R √(1 − (f c)²) + f H c − U c − V t, and
    # its slope over t is `rise`. That is monotone, or concave in t, so its first zero is the only least value inside.
    length = sqrt(dot(d, d))
    f, sink = flat / length, d[2] / length
    u = (-sink * d[0] / flat, -sink * d[1] / flat, f)
    v = (-d[1] / flat, d[0] / flat, 0.0)
    if dot(u, p) < 0.0:
        u = (-u[0], -u[1], -u[2])
    if dot(v, p) < 0.0:
        v = (-v[0], -v[1], -v[2])
    away, side = dot(u, p) - f * half, dot(v, p)
    low, high, t = 0.0, 1.0, 0.0
    for _ in range(60):
        c, inner = sqrt(1.0 - t * t), sqrt(sink * sink + f * f * t * t)
        rise = radius * f * f * t / inner + away * t / c - side
        bend = radius * f * f * sink * sink / inner**3 + away / c**3
        if rise >= 0.0:
            high = t
        else:
            low = t
        if away < 0.0 and bend <= 0.0:
            return best, place, normal  # the least value is on the curved side
        there = t - rise / bend
        if not low <= there <= high:
            there = 0.5 * (low + high)
        if abs(there - t) <= 1e-15 or there >= 1.0:
            break
        t = there
    c = sqrt(1.0 - t * t)
    n = (c * u[0] + t * v[0], c * u[1] + t * v[1], c * u[2])
    level = sqrt(n[0] * n[0] + n[1] * n[1])
    depth = radius * level + half * abs(n[2]) - dot(n, p)
    if depth < best:
        rim = radius / level if level > 0.0 else 0.0
        top = half if n[2] > 0.0 else -half
        ahead = d[0] * (rim * n[0] - p[0]) + d[1] * (rim * n[1] - p[1]) + d[2] * (top - p[2])
        best, place, normal = depth, min(max(ahead / (length * length), 0.0), 1.0), n
    return best, place, normal


@compiled
def segment_box(a: Triple, b: Triple, pose: Array, half: Array) -> NearestPoint:
    """Return the least distance of a segment to a box, minus the depth if they intersect; the segment may be a point.

    Shapes and units: a, b [m], pose (4, 4) [1, m], half (3,) [m]. Returns [m].
    """
    # w has the three excesses as components, each with two breakpoints. The slope d·w of |w|²/2 increases along the segment, so
    # its sign at a breakpoint says on which side the least value lies. Rounding in it counts only the components that
    # change on the piece, so a wrong sign costs no more than rounding of the coordinates.
    p, q = _to_frame(pose, a), _to_frame(pose, b)
    d = (q[0] - p[0], q[1] - p[1], q[2] - p[2])
    h = (half[0], half[1], half[2])
    low, high = 0.0, 1.0
    left, right = _difference_from_box(p, d, h, 0.0), _difference_from_box(p, d, h, 1.0)
    if dot(d, left) >= 0.0:
        high, right = low, left
    elif dot(d, right) <= 0.0:
        low, left = high, right
    else:
        for i in range(3):
            x, y, z = (p[0], d[0], h[0]) if i == 0 else ((p[1], d[1], h[1]) if i == 1 else (p[2], d[2], h[2]))
            if y != 0.0:
                for s in ((z - x) / y, (-z - x) / y):
                    if low < s < high:
                        w = _difference_from_box(p, d, h, s)
                        if dot(d, w) < 0.0:
                            low, left = s, w
                        else:
                            high, right = s, w
    place = low + _nearest_to_origin(left, right)[1] * (high - low)
    w = _difference_from_box(p, d, h, place)
    distance = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    if distance < DISTANCE_ROUNDING:
        depth, share, n = _box_depth(p, d, h)
        if depth > 0.0:
            return -depth, share, _from_frame(pose, (-depth * n[0], -depth * n[1], -depth * n[2]))
    return distance, place, _from_frame(pose, w)


@inlined
def _difference_from_cylinder(p: Triple, radius: float, half: float) -> Triple:
    """Return the difference of a point from the nearest point of a cylinder about z."""
    across = sqrt(p[0] * p[0] + p[1] * p[1])
    out = 1.0 - radius / across if across > radius else 0.0
    return out * p[0], out * p[1], _excess(p[2], half)


@compiled
def _cylinder_place(p: Triple, d: Triple, radius: float, half: float) -> float:
    """Return where the line p + s d, 0 < s < 1, is nearest to a cylinder about z, if the distance falls at 0 and rises at 1."""
    # The slope d·w of |w|²/2 increases, so its zero is between bounds; where Newton's step is not shorter than half of the one
    # before, the interval is halved. The end bounds the error of the distance: |w(s)|² − least ≤ 2 |d·w(s)| (high − low).
    low, high, square = 0.0, 1.0, dot(d, d)
    s, step = min(max(-dot(p, d) / square, 0.0), 1.0), 1.0
    for _ in range(100):
        x = _point_at(p, d, s)
        w = _difference_from_cylinder(x, radius, half)
        slope, length = dot(d, w), sqrt(dot(w, w))
        if slope < 0.0:
            low = s
        else:
            high = s
        if 2.0 * abs(slope) * (high - low) <= CYLINDER_ERROR * max(length, CYLINDER_ERROR):
            break
        bend = d[2] * d[2] if abs(x[2]) > half else 0.0
        across = sqrt(x[0] * x[0] + x[1] * x[1])
        if across > radius:
            along = (x[0] * d[0] + x[1] * d[1]) / across
            bend += (d[0] * d[0] + d[1] * d[1]) * (1.0 - radius / across) + radius / across * along * along
        there = s - slope / bend if bend > 0.0 else -1.0
        if not (low < there < high) or abs(there - s) > 0.5 * step:
            there = 0.5 * (low + high)
        step = abs(there - s)
        if step == 0.0:
            break
        s = there
    return s


@compiled
def segment_cylinder(a: Triple, b: Triple, pose: Array, size: Array) -> NearestPoint:
    """Return the least distance of a segment to a cylinder with flat ends, minus the depth if they intersect.

    Shapes and units: a, b [m], pose (4, 4) of the middle with z along the axis [1, m], size (2,): radius and half length [m].
    Returns [m].
    """
    p, q = _to_frame(pose, a), _to_frame(pose, b)
    d, radius, half = (q[0] - p[0], q[1] - p[1], q[2] - p[2]), size[0], size[1]
    place = 0.0
    if dot(d, _difference_from_cylinder(p, radius, half)) < 0.0:
        place = 1.0
        if dot(d, _difference_from_cylinder(q, radius, half)) > 0.0:
            place = _cylinder_place(p, d, radius, half)
    w = _difference_from_cylinder(_point_at(p, d, place), radius, half)
    distance = sqrt(dot(w, w))
    if distance < DISTANCE_ROUNDING:
        depth, share, n = _cylinder_depth(p, d, radius, half)
        if depth > 0.0:
            return -depth, share, _from_frame(pose, (-depth * n[0], -depth * n[1], -depth * n[2]))
    return distance, place, _from_frame(pose, w)


@compiled
def segment_plane(a: Triple, b: Triple, point: Array, normal: Array) -> NearestPoint:
    """Return the least distance of a segment to a half-space, below 0 inside of it.

    Shapes and units: a, b [m], point (3,) [m], normal (3,) [1]. Returns [m].
    """
    x, y, z = normal[0], normal[1], normal[2]
    first = (a[0] - point[0]) * x + (a[1] - point[1]) * y + (a[2] - point[2]) * z
    last = (b[0] - point[0]) * x + (b[1] - point[1]) * y + (b[2] - point[2]) * z
    distance, place = (first, 0.0) if first <= last else (last, 1.0)
    return distance, place, (distance * x, distance * y, distance * z)


# ---------------- convex meshes


MOST_CORNERS = 4096
"""Most corners of a mesh: all of them are examined for every distance."""
CONVEX = 1e-5
"""Largest distance of a corner in front of a triangle, as a fraction of a convex mesh's size: STL has single precision."""
MESH_ERROR = 1e-12
"""Gap between a distance found and its lower bound [m] at which the search ends."""
SOLID_WIDTH = 18
"""Numbers in a row of `pack_solids`."""
SAME_PLANE = 1e-12
"""Largest difference of the normals of triangles of one face: no edge is between them."""


class Hull(NamedTuple):
    """Convex hull of points.

    Corners (v, 3) [m]; faces (f, 4): outward normal and largest n·x; edges (e, 12): one end, the normals of both faces, and the
    other end; triangles (t, 3, 3).
    """

    corners: Array
    faces: Array
    edges: Array
    triangles: Array


def check_mesh(value: Any, where: str, largest: float) -> Array:
    """Check corners (k, 3) of a convex solid, or triangles (k, 3, 3) of a convex mesh [m]; return the corners."""
    expected = "corners (k, 3) of a convex solid, or triangles (k, 3, 3) of a convex mesh"
    mesh = real_array(value, where, expected)
    if mesh.ndim not in (2, 3) or mesh.shape[1:] not in ((3,), (3, 3)) or len(mesh) < 4:
        raise InvalidInput(where, f"an array of shape {mesh.shape}", expected)
    if not np.isfinite(mesh).all():
        raise InvalidInput(where, format_value(mesh), "finite coordinates")
    if (far := float(np.abs(mesh).max())) > largest:
        raise InvalidInput(
            where, f"a coordinate of {far:.6g} m", f"metres (within {largest:g}): looks like millimetres"
        )
    corners = np.unique(mesh.reshape(-1, 3), axis=0) if mesh.ndim == 3 else mesh
    hull = find_hull(corners, where)
    if mesh.ndim == 3:
        if (out := _measure_dents(mesh, corners)) > CONVEX:
            got = f"a mesh that is not convex: corners lie {100.0 * out:.3g} % of its size in front of a triangle"
            raise InvalidInput(where, got, "a convex mesh; divide it, or pass its corners for the convex hull")
        corners = hull.corners
    if len(corners) > MOST_CORNERS:
        raise InvalidInput(where, f"{len(corners)} corners", f"at most {MOST_CORNERS}")
    return freeze(corners, where)


def is_convex(triangles: Array) -> bool:
    """Return whether a mesh (k, 3, 3) is convex, and not flat or too large."""
    try:
        check_mesh(triangles, "mesh", np.inf)
    except InvalidInput:
        return False
    return True


def _measure_dents(triangles: Array, corners: Array) -> float:
    """Return how far corners lie in front of triangles, as a fraction of the mesh's size."""
    middle, size = corners.mean(axis=0), float(np.linalg.norm(np.ptp(corners, axis=0)))
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=1)
    kept = length > CONVEX**2 * size**2  # slivers have no direction
    normals, points = normals[kept] / length[kept, None], triangles[kept, 0]
    normals *= np.where(((points - middle) * normals).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    out = [float((corners @ n - point @ n).max()) for n, point in zip(normals, points, strict=True)]
    return max(out, default=0.0) / size


def find_hull(corners: Array, where: str = "mesh") -> Hull:
    """Return the convex hull of points (k, 3)."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(corners)
    except (QhullError, ValueError):
        raise InvalidInput(where, f"{len(corners)} corners in a plane", "a solid") from None
    points, normals = corners[np.sort(hull.vertices)], hull.equations[:, :3]
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    faces = np.column_stack([normals, (points @ normals.T).max(axis=0)])
    edges = []
    for one, (triangle, near) in enumerate(zip(hull.simplices, hull.neighbors, strict=True)):
        for k, other in enumerate(near):
            if one < other and np.abs(normals[one] - normals[other]).max() > SAME_PLANE:
                end, far = corners[triangle[(k + 1) % 3]], corners[triangle[(k + 2) % 3]]
                edges.append(np.concatenate([end, normals[one], normals[other], far]))
    return Hull(points, np.unique(faces, axis=0), np.array(edges).reshape(-1, 12), corners[hull.simplices])


def pack_solids(cylinders: list[Array], meshes: tuple[Array, ...], parts: list[tuple[Array, Array]]) -> Array:
    """Return cylinders, meshes and parts of clouds as the rows of one array: kernels count references of each array.

    First a row for each cylinder: its pose, radius and half length. Last a row for each mesh, the first one last: the ranges of
    its rows of corners, faces and edges, and centre and radius of the ball around it. Before the meshes a row for each part of
    a cloud: the range of its rows, and what `pack_cloud` returns beside them.
    """
    rows, heads = [*cylinders], []
    for hull in map(find_hull, meshes):
        ranges = []
        for part in hull[:3]:
            ranges += [len(rows), len(rows) + len(part)]
            rows += list(part)
        low, high = hull.corners.min(axis=0), hull.corners.max(axis=0)
        radius = np.linalg.norm(hull.corners - 0.5 * (low + high), axis=1).max()
        heads.append(np.concatenate([ranges, 0.5 * (low + high), [radius]]))
    for leaves, head in parts:
        heads.append(np.concatenate([[len(rows), len(rows) + len(leaves)], head]))
        rows += list(leaves)
    out = np.zeros((len(rows) + len(heads), SOLID_WIDTH))
    for row, values in zip(out, [*rows, *reversed(heads)], strict=True):
        row[: len(values)] = values
    return freeze(out, "solids")


# ---------------------------------------------------------------- kernels


@compiled
def _mesh_depth(p: Triple, d: Triple, faces: Array, edges: Array) -> NearestPoint:
    """Return the penetration depth of the segment from p along d, its position and its direction; at most 0 if apart."""
    best, place, normal = np.inf, 0.0, (0.0, 0.0, 1.0)
    for i in range(faces.shape[0]):
        n = (faces[i, 0], faces[i, 1], faces[i, 2])
        ahead, slope = dot(n, p), dot(n, d)
        if faces[i, 3] - ahead - min(slope, 0.0) < best:
            best, place, normal = faces[i, 3] - ahead - min(slope, 0.0), 0.0 if slope >= 0.0 else 1.0, n
    for i in range(edges.shape[0]):
        u, v = (edges[i, 3], edges[i, 4], edges[i, 5]), (edges[i, 6], edges[i, 7], edges[i, 8])
        s, t = dot(u, d), dot(v, d)
        if s * t < 0.0:  # on the silhouette: a normal between both is perpendicular to the segment
            s, t = abs(s), abs(t)
            n = (t * u[0] + s * v[0], t * u[1] + s * v[1], t * u[2] + s * v[2])
            length = sqrt(dot(n, n))
            if length > 0.0:
                n = (n[0] / length, n[1] / length, n[2] / length)
                off = (edges[i, 0] - p[0], edges[i, 1] - p[1], edges[i, 2] - p[2])
                if dot(n, off) < best:
                    best, normal = dot(n, off), n
                    e = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
                    along = dot(e, d) / dot(e, e)
                    m = (d[0] - along * e[0], d[1] - along * e[1], d[2] - along * e[2])
                    place = min(max(dot(off, m) / dot(m, m), 0.0), 1.0)
    return best, place, normal


@compiled
def segment_mesh(a: Triple, b: Triple, corners: Array, faces: Array, edges: Array) -> NearestPoint:
    """Return the least distance of a segment to a convex mesh, minus the depth if they intersect; the segment may be a point.

    Shapes and units: a, b [m], corners (v, 3), faces (f, 4), edges (e, 12) of a `Hull` [m, 1]. Returns [m].
    """
    points, at, shares, work = np.empty((4, 3)), np.zeros(4), np.zeros(4), np.empty((5, 4))
    v, share, count, bound = (a[0] - corners[0, 0], a[1] - corners[0, 1], a[2] - corners[0, 2]), 0.0, 1, -np.inf
    points[0, 0], points[0, 1], points[0, 2], shares[0] = v[0], v[1], v[2], 1.0
    length = sqrt(dot(v, v))
    while length >= DISTANCE_ROUNDING and 0 < count < 4:
        far, which = -np.inf, 0
        for i in range(corners.shape[0]):
            ahead = v[0] * corners[i, 0] + v[1] * corners[i, 1] + v[2] * corners[i, 2]
            if ahead > far:
                far, which = ahead, i
        first, last = dot(v, a), dot(v, b)
        end = a if first <= last else b
        bound = max(bound, (min(first, last) - far) / length)
        if length - bound <= MESH_ERROR:
            break
        points[count, 0], points[count, 1] = end[0] - corners[which, 0], end[1] - corners[which, 1]
        points[count, 2], at[count], shares[count] = end[2] - corners[which, 2], 0.0 if first <= last else 1.0, 0.0
        count = reduce_simplex(points, at, shares, count + 1, work)
        x, y, z, s = 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            x, y, z = x + shares[i] * points[i, 0], y + shares[i] * points[i, 1], z + shares[i] * points[i, 2]
            s += shares[i] * at[i]
        shorter = sqrt(x * x + y * y + z * z)
        if count == 0 or shorter >= length:  # rounding: `bound` says how far from the least distance
            break
        v, share, length = (x, y, z), s, shorter
    if length < DISTANCE_ROUNDING or length - bound > 1e3 * MESH_ERROR:
        depth, place, n = _mesh_depth(a, (b[0] - a[0], b[1] - a[1], b[2] - a[2]), faces, edges)
        if depth > 0.0:
            return -depth, place, (-depth * n[0], -depth * n[1], -depth * n[2])
        bound = max(bound, -depth)
    distance = length if length - bound <= 1e3 * MESH_ERROR else max(bound, 0.0)
    scale = distance / length if length > 0.0 else 0.0
    return distance, share, (scale * v[0], scale * v[1], scale * v[2])
