"""Hulls of the parts of a body, closer to it than capsules, and a lower bound of their distance by Wolfe's algorithm.

The part of a mesh in a capsule is cut by planes as long as this makes the hulls of both pieces much smaller than that of the
part. An extreme point of the solid between the planes is on the surface, or where three planes meet. So a hull of the cut
surface and of such points contains the solid, and not only its surface. A hull with many corners is replaced by that of a few
of them, rounded by the largest distance of the others from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from optik import kinematics
from optik.arm.limits import freeze
from optik.arm.shapes import enclosure
from optik.arm.shapes.check import Capsules, check_excess
from optik.arm.shapes.enclosure import Capsule, Hull, Part
from optik.check import check_number, format_value, real_array
from optik.compiled import compiled, inlined
from optik.errors import InvalidInput
from optik.kinematics import Chain, Triple
from optik.types import Array, Flags, Indices

# ---------------- distance of convex hulls that move with the links of an arm


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


@inlined
def _weigh(points: Array, shares: Array, count: int) -> Triple:
    """Return the sum of the first points, each times its share."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(count):
        x, y, z = x + shares[k] * points[k, 0], y + shares[k] * points[k, 1], z + shares[k] * points[k, 2]
    return x, y, z


@compiled
def hull_distance(
    corners: Array, spans: tuple[int, int, int, int], T: Pose, U: Pose, towards: Triple, least: float, seed: Array
) -> tuple[float, float, Triple, Triple]:
    """Return a lower bound on the distance of two hulls, the distance found, a unit normal, and the nearest point of the first.

    For a vector v and all points a and b of the hulls, v·(a − b) is at least its value h at the corner that is the farthest
    along −v of the first hull and along v of the second, because a linear function has its least value at a corner. So
    |a − b| ≥ h / |v|, whatever v is: the bound holds at every step, and rounding and degenerate corners can only make it
    smaller. The distance found is that of two points of the hulls, at least the true one, infinite before there are any. The
    search ends where both agree, where the bound reaches `least`, or where the hulls intersect (then it is at most 0).

    spans: first and last corner of each hull. T, U: their poses. towards: a first direction, from the second hull to the first.
    seed (4,): a number, and pairs of corners with which the search begins, −1 for none; updated with those of its end.
    """
    points, at, shares, work = np.empty((4, 3)), np.empty(4), np.zeros(4), np.empty((5, 4))
    v, far, bound, normal, total = towards, np.inf, -np.inf, (1.0, 0.0, 0.0), corners.shape[0]
    first, count, warm = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]), 0, seed[1] >= 0.0
    size = first
    for step in range(MOST_STEPS):
        known = step < 3 and seed[step + 1] >= 0.0
        if known:
            i, j = int(seed[step + 1]) // total, int(seed[step + 1]) % total
        else:
            i = find_farthest(corners, spans[0], spans[1], T, (-v[0], -v[1], -v[2]))
            j = find_farthest(corners, spans[2], spans[3], U, v)
        a = _place(T, corners[i, 0], corners[i, 1], corners[i, 2])
        b = _place(U, corners[j, 0], corners[j, 1], corners[j, 2])
        m = (a[0] - b[0], a[1] - b[1], a[2] - b[2])
        if not known and size > 0.0:
            ahead = (v[0] * m[0] + v[1] * m[1] + v[2] * m[2]) / size
            if ahead > bound:
                bound, normal = ahead, (v[0] / size, v[1] / size, v[2] / size)
            if far - bound <= HULL_ERROR or bound >= least:
                break
        points[count, 0], points[count, 1], points[count, 2] = m
        at[count], shares[count], before = i * total + j, 1.0 if count == 0 else 0.0, count
        count = reduce_simplex(points, at, shares, count + 1, work) if count > 0 else 1
        x, y, z = _weigh(points, shares, count)
        shorter = sqrt(x * x + y * y + z * z)
        rounding, meets = count == 0 or (not known and shorter >= far), count == 4 or shorter <= HULL_ERROR
        if (
            warm and (rounding or meets) and far - bound > HULL_ERROR
        ):  # corners of the seed may be dependent: begin anew
            seed[1:], count, far, v, size, warm = -1.0, 0, np.inf, towards, first, False
            continue
        if rounding:
            count = max(count, before)
            break
        v, far, size = (x, y, z), shorter, shorter
        if meets:
            break
    p = 0.0, 0.0, 0.0
    seed[1:] = -1.0
    for k in range(count):
        c = int(at[k]) // total
        a = _place(T, corners[c, 0], corners[c, 1], corners[c, 2])
        p = p[0] + shares[k] * a[0], p[1] + shares[k] * a[1], p[2] + shares[k] * a[2]
        if k < 3:
            seed[k + 1] = at[k]
    return bound, far, normal, p


@inlined
def _is_far(a: Triple, b: Triple, reach: float) -> bool:
    """Return whether two points are farther apart than a distance."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return bool(x * x + y * y + z * z > reach * reach)


@compiled
def nearest_hulls(
    one: int, other: int, hulls: Hulls, frame: Array, least: float, seed: Array
) -> tuple[float, Triple, Triple]:
    """Return a lower bound on the distance of two bodies by their hulls, a unit normal, and the nearest point of the first.

    Each hull is rounded: all points within its radius belong to it, so the radii of both are subtracted. At most 0 in contact.
    From `least` on the bound is `least`, without normal and point. seed (2, 4), updated: the pair of hulls that was the nearest
    at another configuration, and the corners that decided, or −1; and memory.

    Shapes and units: frame (n, 4, 4) [1, m]. Returns [m, 1, m].
    """
    index, heads, corners, _kinds = hulls
    T, U = pose_of(frame, index[one, 1]), pose_of(frame, index[other, 1])
    best, normal, point, first, count = least, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), int(seed[0, 0]), heads.shape[0]
    rows, columns = index[one + 1, 0] - index[one, 0], index[other + 1, 0] - index[other, 0]
    for turn in range(-1, rows * columns):  # first the pair that was the nearest
        i, j = (first // count, first % count) if turn < 0 else (turn // columns, turn % columns)
        if turn >= 0:
            i, j = i + index[one, 0], j + index[other, 0]
        elif not (index[one, 0] <= i < index[one + 1, 0] and index[other, 0] <= j < index[other + 1, 0]):
            continue
        if turn >= 0 and i * count + j == first:
            continue
        c, d = _place(T, heads[i, 2], heads[i, 3], heads[i, 4]), _place(U, heads[j, 2], heads[j, 3], heads[j, 4])
        off, thick = (c[0] - d[0], c[1] - d[1], c[2] - d[2]), heads[i, 6] + heads[j, 6]
        if _is_far(c, d, best + heads[i, 5] + heads[j, 5]):
            continue
        spans, at = (int(heads[i, 0]), int(heads[i, 1]), int(heads[j, 0]), int(heads[j, 1])), min(turn + 1, 1)
        if turn >= 0:
            seed[1] = -1.0
        bound, _found, n, p = hull_distance(corners, spans, T, U, off, best + thick, seed[at])
        if bound - thick < best:
            best, normal, point = bound - thick, n, p
            seed[0, 0], seed[0, 1:] = i * count + j, seed[at, 1:]
            if best <= 0.0:
                break
    return best, normal, point


@compiled
def distances_from_hull(corners: Array, points: Array, out: Array) -> None:
    """Write upper bounds on the distances of points from the hull of corners.

    Shapes and units: corners (v, 3), points (k, 3) [m], out (k,) [m].
    """
    both, T = np.concatenate((corners, points)), (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    count, c, seed = corners.shape[0], corners[0], np.full(4, -1.0)
    for k in range(points.shape[0]):
        towards, seed[1:] = (points[k, 0] - c[0], points[k, 1] - c[1], points[k, 2] - c[2]), -1.0
        out[k] = hull_distance(both, (count + k, count + k + 1, 0, count), T, T, towards, np.inf, seed)[1]


@compiled
def mark_behind(points: Array, planes: Array, slack: float, behind: Flags) -> None:
    """Write which points are behind all planes, or at most so far in front of one; the plane of the last one is tried first.

    Shapes and units: points (k, 3), slack [m], planes (f, 4) [1, m], behind (k,).
    """
    last, count = 0, planes.shape[0]
    for k in range(points.shape[0]):
        behind[k] = True
        for i in range(count):
            n = planes[(last + i) % count]
            if n[0] * points[k, 0] + n[1] * points[k, 1] + n[2] * points[k, 2] > n[3] + slack:
                behind[k], last = False, (last + i) % count
                break


@compiled
def find_contacts(chain: Chain, hulls: Hulls, pairs: Indices, q: Array, touching: Flags) -> None:
    """Write which pairs of parts of an arm are in contact by their hulls at configurations.

    Shapes and units: pairs (p, 3) of two bodies and the number of the pair of parts, q (k, n) [rad, m], touching (parts, k).
    """
    frame, seed = np.empty((q.shape[1], 4, 4)), np.full((2, 4), -1.0)
    touching[:] = False
    for k in range(q.shape[0]):
        kinematics.frames(chain, q[k], frame)
        for p in range(pairs.shape[0]):
            if not touching[pairs[p, 2], k]:
                touching[pairs[p, 2], k] = (
                    nearest_hulls(pairs[p, 0], pairs[p, 1], hulls, frame, HULL_ERROR, seed)[0] <= 0.0
                )


@inlined
def _is_met(i: int, j: int, meshes: Hulls, T: Pose, U: Pose) -> bool:
    """Return whether two triangles of meshes have a common point."""
    _index, heads, corners, _kinds = meshes
    c, d = _place(T, heads[i, 2], heads[i, 3], heads[i, 4]), _place(U, heads[j, 2], heads[j, 3], heads[j, 4])
    if _is_far(c, d, heads[i, 5] + heads[j, 5]):
        return False
    spans = (int(heads[i, 0]), int(heads[i, 1]), int(heads[j, 0]), int(heads[j, 1]))
    off = (c[0] - d[0], c[1] - d[1], c[2] - d[2])
    return bool(hull_distance(corners, spans, T, U, off, 2.0 * HULL_ERROR, np.full(4, -1.0))[1] <= HULL_ERROR)


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
        met, middle = False, _place(U, balls[1, 0], balls[1, 1], balls[1, 2])
        for row in range(min(count, MOST_KNOWN)):
            met = met or _is_met(known[row, 0], known[row, 1], meshes, T, U)
        for i in range(index[1, 0]):
            if met or _is_far(_place(T, heads[i, 2], heads[i, 3], heads[i, 4]), middle, heads[i, 5] + balls[1, 3]):
                continue
            for j in range(index[1, 0], index[2, 0]):
                if _is_met(i, j, meshes, T, U):
                    known[count % MOST_KNOWN], met = (i, j), True
                    count += 1
                    break
        if not met:
            return int(k)
    return int(q.shape[0])


# ---------------- hulls of the parts of a body


MOST_CORNERS = 96
"""Most corners of a hull: the time of a distance grows with their number."""
ROUNDED = 5e-4
"""Rounding radius [m] from which no more corners are added."""
MOST_HULLS = 8
"""Most hulls of the part of a mesh in one capsule."""
WORTH_HALVING = 0.03
"""A part is cut if this reduces the volume of its hulls by at least this fraction of the volume of the body's hulls."""
WORTH_FREEING = 8e-6
"""Volume [m³] that is worth a cut of any part."""
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
    tree = enclosure.sample_points(triangles)
    capsules, parts = enclosure.enclose_parts(triangles, tree)
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
    rounding = radius * float(1.0 - np.cos(np.pi / RING)) + enclosure.ENCLOSURE_ROUNDING
    hull = Hull(np.concatenate([ring, ring * (1.0, 1.0, -1.0)]), rounding, 2.0 * rounding)
    return [enclosure.enclose_cylinder(radius, length)._replace(hulls=(hull,))]


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
    behind = np.empty(points.shape[:-1], np.bool_)
    mark_behind(points.reshape(-1, 3), planes, slack, behind.reshape(-1))
    return behind


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
            return Hull(points[chosen], float(far[best]) + enclosure.ENCLOSURE_ROUNDING)
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
            if near and enclosure.distance_to_segment(x[None], capsule.a, capsule.b)[0] <= capsule.radius:
                points.append(x[None])
    return find_hull(np.concatenate(points))


def _cut(part: Part, around: tuple[Solid, Capsule]) -> list[Solid]:
    """Cut the part of a mesh by planes, the piece first whose hulls become smaller by the most; return the hulls."""
    pieces = [(part, _hull_of(part, around))]
    halves = [_halve(*pieces[0], around)]
    least = min(WORTH_HALVING * pieces[0][1].volume, WORTH_FREEING)
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
    for u in enclosure.find_axes(hull.points):
        low, high = float((hull.points @ u).min()), float((hull.points @ u).max())
        for share in enclosure.CUTS:
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
    step = float(np.ptp(tree.data, axis=0).max()) / enclosure.SPACING
    thick = 2.0 * max(hull.radius for hull in hulls) + MET
    measured = []
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
        measured.append(hull._replace(excess=bound + hull.radius))
    return measured


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
    if not enclosure.distance_to_segment(corners, a, b).max() <= radius + 2.0 * enclosure.ENCLOSURE_ROUNDING:
        raise InvalidInput(where, "a corner outside of its capsule", "corners inside of it")
    excess = np.nan if len(value) == 2 or value[2] is None else float(check_excess(value[2], 1, where)[0])
    return Hull(corners, check_number(value[1], where, "a radius", least=0.0), excess)
