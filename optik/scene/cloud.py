"""Point clouds: balls of one radius, in parts of near points, and the exact distance of a segment to a part.

A cloud is divided at medians into parts of up to `PART_POINTS` points, and a part into leaves of up to `SOLID_WIDTH` points.
Each part is a solid of its own, which is not convex.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from optik.check import format_value, real_array
from optik.compiled import compiled, inlined
from optik.errors import InvalidInput
from optik.kinematics import Triple
from optik.scene.distance import DISTANCE_ROUNDING, SOLID_WIDTH, NearestPoint, dot
from optik.types import Array

MOST_CLOUD_POINTS = 1_000_000
"""Most points of a cloud: as JSON they fill a file of a scene."""
PART_POINTS = 1024
"""Most points of a part: the distance of a part finds them in a list of its leaves, the parts are pairs of their own."""
LEAST_PARTS, LEAST_POINTS = 8, 128
"""Parts into which a cloud is divided at least, unless they have fewer points than this."""
LEAF_ROWS = 4
"""Rows of a leaf among the solids: centre and radius of the ball around its points, and a row for each coordinate."""
SHORTEST_SQUARE = 1e-300
"""Squared length of an axis [m²] up to which it counts as a point: 1 over it stays finite."""


def check_points(value: Any, where: str, largest: float) -> Array:
    """Check the points (k, 3) of a cloud [m], and return them."""
    expected = f"1 to {MOST_CLOUD_POINTS} points (k, 3)"
    points = real_array(value, where, expected)
    if points.ndim != 2 or points.shape[1] != 3 or not 0 < len(points) <= MOST_CLOUD_POINTS:
        raise InvalidInput(where, f"an array of shape {points.shape}", expected)
    bad = np.flatnonzero(~(np.abs(points) <= largest).all(axis=1))
    if len(bad):
        got = f"point {bad[0]}: {format_value(points[bad[0]].tolist())}"
        raise InvalidInput(where, got, f"finite metres (within {largest:g}): more looks like millimetres")
    return points


def count_parts(points: int) -> int:
    """Return the number of parts of a cloud with so many points."""
    return _count_halves(points, max(LEAST_POINTS, min(PART_POINTS, -(-points // LEAST_PARTS))))


def _count_halves(points: int, most: int) -> int:
    """Return the power of two that divides points into groups of at most so many."""
    return 1 << (-(-points // most) - 1).bit_length()


def _divide(points: Array, count: int) -> list[Array]:
    """Divide points into halves at the median of their widest coordinate, until there are so many parts."""
    parts = [points]
    while len(parts) < count:
        ordered = [part[np.argsort(part[:, np.ptp(part, axis=0).argmax()], kind="stable")] for part in parts]
        parts = [half for part in ordered for half in np.array_split(part, 2)]
    return parts


def divide_cloud(points: Array) -> list[Array]:
    """Return the points of each part of a cloud."""
    return _divide(points, count_parts(len(points)))


def pack_cloud(points: Array, radius: float) -> list[tuple[Array, Array]]:
    """Return for each part the rows of its leaves, and its low and high corners (points only) and radius."""
    packed = []
    for part in divide_cloud(points):
        leaves = _divide(part, _count_halves(len(part), SOLID_WIDTH))
        rows = np.zeros((len(leaves), LEAF_ROWS, SOLID_WIDTH))
        for row, leaf in zip(rows, leaves, strict=True):
            row[0, :3] = 0.5 * (leaf.min(axis=0) + leaf.max(axis=0))
            row[0, 3] = np.linalg.norm(leaf - row[0, :3], axis=1).max()
            row[1:] = np.pad(leaf, ((0, SOLID_WIDTH - len(leaf)), (0, 0)), mode="edge").T
        head = np.concatenate([part.min(axis=0), part.max(axis=0), [radius]])
        packed.append((rows.reshape(-1, SOLID_WIDTH), head))
    return packed


# ---------------------------------------------------------------- kernels


@inlined
def _offset(a: Triple, d: Triple, scale: float, p: Triple) -> tuple[float, float, Triple]:
    """Return the squared distance of a segment to a point, the position on the segment, and the difference."""
    x, y, z = a[0] - p[0], a[1] - p[1], a[2] - p[2]
    t = min(max(-(x * d[0] + y * d[1] + z * d[2]) * scale, 0.0), 1.0)
    w = (x + t * d[0], y + t * d[1], z + t * d[2])
    return dot(w, w), t, w


@compiled
def segment_cloud(a: Triple, b: Triple, solids: Array, i: int) -> NearestPoint:
    """Return the least distance of a segment to the balls of a part of a cloud, below 0 inside one.

    Shapes and units: a, b [m], solids of `pack_solids`. Returns [m].
    """
    head, d = solids.shape[0] - 1 - i, (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    first, last, square = int(solids[head, 0]), int(solids[head, 1]), dot(d, d)
    scale = 1.0 / square if square > SHORTEST_SQUARE else 0.0
    reach, best, share, w = np.inf, np.inf, 0.0, (0.0, 0.0, 0.0)
    for row in range(first, last, LEAF_ROWS):  # every point of a leaf is within its radius of its centre
        centre = (solids[row, 0], solids[row, 1], solids[row, 2])
        reach = min(reach, sqrt(_offset(a, d, scale, centre)[0]) + solids[row, 3])
    reach += DISTANCE_ROUNDING
    for row in range(first, last, LEAF_ROWS):
        far = reach + solids[row, 3]
        if _offset(a, d, scale, (solids[row, 0], solids[row, 1], solids[row, 2]))[0] > far * far:
            continue
        for k in range(SOLID_WIDTH):
            p = (solids[row + 1, k], solids[row + 2, k], solids[row + 3, k])
            square_distance, place, off = _offset(a, d, scale, p)
            if square_distance < best:
                best, share, w = square_distance, place, off
        reach = min(reach, sqrt(best) + DISTANCE_ROUNDING)
    length = sqrt(best)
    distance = length - solids[head, 8]
    ratio = distance / length if length > 0.0 else 0.0  # a segment through a point has no direction
    return distance, share, (ratio * w[0], ratio * w[1], ratio * w[2])
