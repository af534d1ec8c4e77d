"""Exact distances of a segment, the axis of a capsule, to a segment, a box and a plane.

For a point p(s) of a segment, let w(s) be its difference from the nearest point of a convex set. |w(s)| is convex, and for a
box or another segment w is piecewise linear in s, with at most six breakpoints. So the least |w| lies on one piece, where it is
the distance of the origin to the segment between the piece's ends. The error of a distance is rounding
only, less than `DISTANCE_ROUNDING` for coordinates up to `LARGEST_COORDINATE`.
"""

from __future__ import annotations

from math import sqrt

from optik.compiled import compiled, inlined
from optik.kinematics import Triple
from optik.types import Array

NearestPoint = tuple[float, float, Triple]
"""Least distance [m], the position on the first segment as a fraction from 0 to 1, and the difference there from the nearest
point of the other body (3,) [m]."""
DISTANCE_ROUNDING = 1e-9
"""Bound of the error of a distance [m], with the rounding of poses: several hundred times 2e-16 of `LARGEST_COORDINATE`."""
LARGEST_COORDINATE = 1e4
"""Largest coordinate [m] for which `DISTANCE_ROUNDING` holds."""


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
def _dot(u: Triple, v: Triple) -> float:
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
            found, share = _nearest_to_origin(left, right)
            if best < 0.0 or found < best:
                best, place = found, low + share * (high - low)
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


@compiled
def segment_box(a: Triple, b: Triple, pose: Array, half: Array) -> NearestPoint:
    """Return the least distance of a segment to a box, 0 if they intersect; the segment may be a point.

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
    if _dot(d, left) >= 0.0:
        high, right = low, left
    elif _dot(d, right) <= 0.0:
        low, left = high, right
    else:
        for i in range(3):
            x, y, z = (p[0], d[0], h[0]) if i == 0 else ((p[1], d[1], h[1]) if i == 1 else (p[2], d[2], h[2]))
            if y != 0.0:
                for s in ((z - x) / y, (-z - x) / y):
                    if low < s < high:
                        w = _difference_from_box(p, d, h, s)
                        if _dot(d, w) < 0.0:
                            low, left = s, w
                        else:
                            high, right = s, w
    place = low + _nearest_to_origin(left, right)[1] * (high - low)
    w = _difference_from_box(p, d, h, place)
    T = pose
    return (
        sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]),
        place,
        (
            T[0, 0] * w[0] + T[0, 1] * w[1] + T[0, 2] * w[2],
            T[1, 0] * w[0] + T[1, 1] * w[1] + T[1, 2] * w[2],
            T[2, 0] * w[0] + T[2, 1] * w[1] + T[2, 2] * w[2],
        ),
    )


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
