"""Convex meshes: their convex hull as arrays, and the exact distance of a segment to it.

Outside, the distance is that of the origin to the Minkowski difference of segment and mesh, by Wolfe's algorithm (Finding the
nearest point in a polytope, 1976), which ends after finitely many steps. A direction proves a lower bound; if rounding leaves a
gap between it and the distance found, the bound is returned. Inside, every face and every edge on the silhouette is tried.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from optik.arm.limits import freeze
from optik.arm.shapes.hull_distance import reduce_simplex
from optik.check import format_value, real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.kinematics import Triple
from optik.scene.distance import DISTANCE_ROUNDING, NearestPoint, dot
from optik.types import Array

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
    given = real_array(value, where, expected)
    if given.ndim not in (2, 3) or given.shape[1:] not in ((3,), (3, 3)) or len(given) < 4:
        raise InvalidInput(where, f"an array of shape {given.shape}", expected)
    if not np.isfinite(given).all():
        raise InvalidInput(where, format_value(given), "finite coordinates")
    if (far := float(np.abs(given).max())) > largest:
        raise InvalidInput(
            where, f"a coordinate of {far:.6g} m", f"metres (within {largest:g}): looks like millimetres"
        )
    corners = np.unique(given.reshape(-1, 3), axis=0) if given.ndim == 3 else given
    hull = find_hull(corners, where)
    if given.ndim == 3:
        if (out := _measure_dents(given, corners)) > CONVEX:
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
    found = length if length - bound <= 1e3 * MESH_ERROR else max(bound, 0.0)
    scale = found / length if length > 0.0 else 0.0
    return found, share, (scale * v[0], scale * v[1], scale * v[2])
