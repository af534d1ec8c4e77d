"""Distance of convex hulls that move with the links of an arm: a lower bound by Wolfe's algorithm, equal to rounding.

The distance is that of the origin to the Minkowski difference of both hulls (Wolfe, Finding the nearest point in a polytope,
1976). Every step has a direction, and a direction proves a lower bound, which is what is returned.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from optik import kinematics
from optik.compiled import compiled, inlined
from optik.kinematics import Chain, Triple
from optik.types import Array, Flags, Indices

Hulls = tuple[Indices, Array, Array, Indices]
"""Hulls of bodies as kernels take them: first hull and link (bodies + 1, 2) of each body; of each hull (h, 7) the range of its
corners, centre and radius of a ball around it, and its rounding radius [m]; corners (v, 3) in the frames of the links [m]; and
the number of the first body of each kind of a pair (7,), see `optik.scene.contact`. Empty for an arm without hulls."""
Pose = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""The upper three rows of a transform."""
HULL_ERROR = 1e-7
"""Gap between a distance found and its lower bound [m] at which the search ends."""
MOST_KNOWN = 1000
"""Most pairs of triangles that are remembered."""
MOST_STEPS = 200
"""Most steps of a search: the lower bound of the last one holds."""


@compiled
def _affine_minimum(points: Array, count: int, work: Array) -> bool:
    """Compute the affine combination of points (count, 3) nearest to the origin, row 4 of `work`; False if dependent."""
    A, k = work, count - 1  # the right side is row 3
    for i in range(k):
        for j in range(k):
            A[i, j] = 0.0
            for c in range(3):
                A[i, j] += (points[i + 1, c] - points[0, c]) * (points[j + 1, c] - points[0, c])
        A[3, i] = 0.0
        for c in range(3):
            A[3, i] -= (points[i + 1, c] - points[0, c]) * points[0, c]
    for i in range(k):  # Cholesky's factor below the diagonal, and forward substitution
        for j in range(i + 1):
            for m in range(j):
                A[i, j] -= A[i, m] * A[j, m]
            if j < i:
                A[i, j] /= A[j, j]
        if not A[i, i] > 0.0:
            return False
        A[i, i] = sqrt(A[i, i])
        for m in range(i):
            A[3, i] -= A[i, m] * A[3, m]
        A[3, i] /= A[i, i]
    A[4, 0] = 1.0
    for i in range(k - 1, -1, -1):
        for m in range(i + 1, k):
            A[3, i] -= A[m, i] * A[3, m]
        A[3, i] /= A[i, i]
        A[4, i + 1] = A[3, i]
        A[4, 0] -= A[3, i]
    return True


@compiled
def reduce_simplex(points: Array, at: Array, shares: Array, count: int, work: Array) -> int:
    """Move to the point of the simplex that is nearest to the origin, and drop the corners that it does not need.

    points (4, 3) and at (4,), a number of each point, are reordered; shares (4,) of the point before, the last one 0; work
    (5, 4) is overwritten. Returns the number of corners; 0 if they are dependent.
    """
    while True:
        if not _affine_minimum(points, count, work):
            return 0
        step = 1.0
        for i in range(count):
            if work[4, i] <= 0.0 and shares[i] - work[4, i] > 0.0:
                step = min(step, shares[i] / (shares[i] - work[4, i]))
        kept = 0
        for i in range(count):
            left = shares[i] + step * (work[4, i] - shares[i])
            if work[4, i] > 0.0 or (step < 1.0 and left > 1e-15):
                for c in range(3):
                    points[kept, c] = points[i, c]
                at[kept], shares[kept] = at[i], left
                kept += 1
        if step == 1.0 or kept == count or kept == 0:
            return kept
        count = kept


@inlined
def pose_of(frame: Array, link: int) -> Pose:
    """Return the pose of a link in the base frame: frame (n, 4, 4) [1, m]."""
    if link == 0:
        return 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0
    T, j = frame, link - 1
    return (
        T[j, 0, 0], T[j, 0, 1], T[j, 0, 2], T[j, 0, 3],
        T[j, 1, 0], T[j, 1, 1], T[j, 1, 2], T[j, 1, 3],
        T[j, 2, 0], T[j, 2, 1], T[j, 2, 2], T[j, 2, 3],
    )  # fmt: skip


@inlined
def _place(T: Pose, x: float, y: float, z: float) -> Triple:
    return (
        T[0] * x + T[1] * y + T[2] * z + T[3],
        T[4] * x + T[5] * y + T[6] * z + T[7],
        T[8] * x + T[9] * y + T[10] * z + T[11],
    )


@inlined
def find_farthest(corners: Array, first: int, last: int, T: Pose, v: Triple) -> int:
    """Return the corner of a hull that is the farthest along a direction of the base frame."""
    x = T[0] * v[0] + T[4] * v[1] + T[8] * v[2]
    y = T[1] * v[0] + T[5] * v[1] + T[9] * v[2]
    z = T[2] * v[0] + T[6] * v[1] + T[10] * v[2]
    far, which = -np.inf, first
    for i in range(first, last):
        ahead = x * corners[i, 0] + y * corners[i, 1] + z * corners[i, 2]
        if ahead > far:
            far, which = ahead, i
    return which


@compiled
def hull_distance(
    corners: Array, spans: tuple[int, int, int, int], T: Pose, U: Pose, towards: Triple, least: float
) -> tuple[float, float, Triple, Triple]:
    """Return a lower bound on the distance of two hulls, the distance found, a unit normal, and the nearest point of the first.

    For a vector v and all points a and b of the hulls, v·(a − b) is at least its value h at the corner that is the farthest
    along −v of the first hull and along v of the second, because a linear function has its least value at a corner. So
    |a − b| ≥ h / |v|, whatever v is: the bound holds at every step, and rounding and degenerate corners can only make it
    smaller. The distance found is that of two points of the hulls, so it is at least the true one. The search ends where both
    agree, where the bound reaches `least`, or where the hulls intersect (then the bound is at most 0).

    spans: first and last corner of each hull. T, U: their poses. towards: a first direction, from the second hull to the first.
    """
    points, at, shares, work = np.empty((4, 3)), np.zeros(4), np.zeros(4), np.empty((5, 4))
    v, length, bound, normal = towards, 1.0, -np.inf, (1.0, 0.0, 0.0)
    point, count, begins = (0.0, 0.0, 0.0), 0, True
    for _ in range(MOST_STEPS):
        i = find_farthest(corners, spans[0], spans[1], T, (-v[0], -v[1], -v[2]))
        j = find_farthest(corners, spans[2], spans[3], U, v)
        a = _place(T, corners[i, 0], corners[i, 1], corners[i, 2])
        b = _place(U, corners[j, 0], corners[j, 1], corners[j, 2])
        m = (a[0] - b[0], a[1] - b[1], a[2] - b[2])
        if begins:
            count, begins = 1, False
            points[0, 0], points[0, 1], points[0, 2], at[0], shares[0] = m[0], m[1], m[2], i, 1.0
        else:
            ahead = (v[0] * m[0] + v[1] * m[1] + v[2] * m[2]) / length
            if ahead > bound:
                bound, normal = ahead, (v[0] / length, v[1] / length, v[2] / length)
            if length - bound <= HULL_ERROR or bound >= least:
                break
            points[count, 0], points[count, 1], points[count, 2] = m
            at[count], shares[count] = i, 0.0
            count = reduce_simplex(points, at, shares, count + 1, work)
        x, y, z = 0.0, 0.0, 0.0
        for k in range(count):
            x, y, z = x + shares[k] * points[k, 0], y + shares[k] * points[k, 1], z + shares[k] * points[k, 2]
        shorter = sqrt(x * x + y * y + z * z)
        if count == 0 or (bound > -np.inf and shorter >= length):  # rounding
            break
        v, length, point = (x, y, z), shorter, (0.0, 0.0, 0.0)
        for k in range(count):
            c = int(at[k])
            p = _place(T, corners[c, 0], corners[c, 1], corners[c, 2])
            point = point[0] + shares[k] * p[0], point[1] + shares[k] * p[1], point[2] + shares[k] * p[2]
        if count == 4 or length <= HULL_ERROR:
            break
    return bound, length, normal, point


@inlined
def _is_far(a: Triple, b: Triple, reach: float) -> bool:
    """Return whether two points are farther apart than a distance."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return bool(x * x + y * y + z * z > reach * reach)


@compiled
def nearest_hulls(one: int, other: int, hulls: Hulls, frame: Array) -> tuple[float, Triple, Triple]:
    """Return a lower bound on the distance of two bodies by their hulls, a unit normal, and the nearest point of the first.

    Each hull is rounded: all points within its radius belong to it, so the radii of both are subtracted. At most 0 in contact.

    Shapes and units: frame (n, 4, 4) [1, m]. Returns [m, 1, m].
    """
    index, heads, corners, _kinds = hulls
    T, U = pose_of(frame, index[one, 1]), pose_of(frame, index[other, 1])
    best, normal, point = np.inf, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(index[one, 0], index[one + 1, 0]):
        c = _place(T, heads[i, 2], heads[i, 3], heads[i, 4])
        for j in range(index[other, 0], index[other + 1, 0]):
            d = _place(U, heads[j, 2], heads[j, 3], heads[j, 4])
            off, thick = (c[0] - d[0], c[1] - d[1], c[2] - d[2]), heads[i, 6] + heads[j, 6]
            if _is_far(c, d, best + heads[i, 5] + heads[j, 5]):
                continue
            spans = (int(heads[i, 0]), int(heads[i, 1]), int(heads[j, 0]), int(heads[j, 1]))
            bound, _found, n, p = hull_distance(corners, spans, T, U, off, best + thick)
            if bound - thick < best:
                best, normal, point = bound - thick, n, p
                if best <= 0.0:
                    return best, normal, point
    return best, normal, point


@compiled
def distances_from_hull(corners: Array, points: Array, out: Array) -> None:
    """Write upper bounds on the distances of points from the hull of corners.

    Shapes and units: corners (v, 3), points (k, 3) [m], out (k,) [m].
    """
    both, T = np.concatenate((corners, points)), (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    count, c = corners.shape[0], corners[0]
    for k in range(points.shape[0]):
        towards = (points[k, 0] - c[0], points[k, 1] - c[1], points[k, 2] - c[2])
        out[k] = hull_distance(both, (count + k, count + k + 1, 0, count), T, T, towards, np.inf)[1]


@compiled
def find_contacts(chain: Chain, hulls: Hulls, pairs: Indices, q: Array, touching: Flags) -> None:
    """Write which pairs of parts of an arm are in contact by their hulls at configurations.

    Shapes and units: pairs (p, 3) of two bodies and the number of the pair of parts, q (k, n) [rad, m], touching (parts, k).
    """
    frame = np.empty((q.shape[1], 4, 4))
    touching[:] = False
    for k in range(q.shape[0]):
        kinematics.frames(chain, q[k], frame)
        for p in range(pairs.shape[0]):
            if not touching[pairs[p, 2], k]:
                touching[pairs[p, 2], k] = nearest_hulls(pairs[p, 0], pairs[p, 1], hulls, frame)[0] <= 0.0


@inlined
def _is_met(i: int, j: int, meshes: Hulls, T: Pose, U: Pose) -> bool:
    """Return whether two triangles of meshes have a common point."""
    _index, heads, corners, _kinds = meshes
    c, d = _place(T, heads[i, 2], heads[i, 3], heads[i, 4]), _place(U, heads[j, 2], heads[j, 3], heads[j, 4])
    if _is_far(c, d, heads[i, 5] + heads[j, 5]):
        return False
    spans = (int(heads[i, 0]), int(heads[i, 1]), int(heads[j, 0]), int(heads[j, 1]))
    off = (c[0] - d[0], c[1] - d[1], c[2] - d[2])
    return bool(hull_distance(corners, spans, T, U, off, np.inf)[1] <= HULL_ERROR)


@compiled
def count_crossings(chain: Chain, meshes: Hulls, balls: Array, q: Array) -> int:
    """Return how many configurations from the first one on have contact of two meshes: bodies whose hulls are triangles.

    Shapes and units: balls (2, 4) around the meshes, q (k, n) [rad, m].
    """
    index, heads, frame = meshes[0], meshes[1], np.empty((q.shape[1], 4, 4))
    known, count = np.empty((MOST_KNOWN, 2), np.int64), 0  # pairs of triangles that touched before are tried first
    for k in range(q.shape[0]):
        kinematics.frames(chain, q[k], frame)
        T, U = pose_of(frame, index[0, 1]), pose_of(frame, index[1, 1])
        found, middle = False, _place(U, balls[1, 0], balls[1, 1], balls[1, 2])
        for row in range(min(count, MOST_KNOWN)):
            found = found or _is_met(known[row, 0], known[row, 1], meshes, T, U)
        for i in range(index[1, 0]):
            if found or _is_far(_place(T, heads[i, 2], heads[i, 3], heads[i, 4]), middle, heads[i, 5] + balls[1, 3]):
                continue
            for j in range(index[1, 0], index[2, 0]):
                if _is_met(i, j, meshes, T, U):
                    known[count % MOST_KNOWN], found = (i, j), True
                    count += 1
                    break
        if not found:
            return int(k)
    return int(q.shape[0])
