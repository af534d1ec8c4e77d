"""Free motion of redundant arms, compiled: configurations carried from station to station, and made smooth together."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.kinematics import Chain, frames, jacobian_from, tool_pose
from optik.linear import cholesky_solve, damped_step
from optik.se3 import pose_error
from optik.types import Array

LARGEST_EDGE = 0.7
"""Largest joint motion from a station to the next [rad or m], before it is made smooth."""

ROOM = 0.3
"""Weight of the room to the limits, −Σ ln(1 − x²) with x = (q − middle) / half range, beside ½ the squared motion."""

EDGE = 0.98
"""Beyond this x the logarithm is continued as a parabola."""

ROUNDS = 12
"""Of making the free motion smooth."""

SMOOTH = 1e-4
"""It is smooth where a round moves no joint further than this [rad or m]."""

LARGEST_MOVE = 0.2
"""Of a joint in one round [rad or m]."""

AWAY = 0.05
"""Largest free motion away from the limits while configurations are carried to the next station [rad or m]."""

REACHED = 1e-9
"""Error that brings a configuration to its station [m, rad]."""


@compiled
def come_to(chain: Chain, target: Array, q: Array, J: Array) -> float:
    """Bring q (n,), in place, the shortest way onto a target; the error left [m, rad], and the Jacobian (6, n) there."""
    n = q.shape[0]
    frame, T, e, dq = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty(6), np.empty(n)
    A, y, best, worst = np.empty((6, 6)), np.empty(6), np.empty(n), np.inf
    for _ in range(12):
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        pose_error(T, target, e)
        error = 0.0
        for i in range(6):
            error = max(error, abs(e[i]))
        if not error < worst:
            q[:] = best  # rounding, or no progress: J is that of a step further
            break
        worst, best[:] = error, q
        jacobian_from(chain, frame, T, J)
        if error < 1e-14 or not damped_step(J, e, 0.0, A, y, dq):
            break
        for i in range(n):
            q[i] += dq[i]
    return worst


@compiled
def free_directions(J: Array, before: Array, N: Array) -> float:
    """Orthonormal directions (n, d) of free motion, like those before; how alike the least is, 1 for those that stay.

    The directions before, less what J sees of them, then made orthonormal one by one.
    """
    n, d = before.shape
    e, A, y, x = np.empty(6), np.empty((6, 6)), np.empty(6), np.empty(n)
    least = 1.0
    for c in range(d):
        for again in range(2):  # the second time mends rounding
            source = N if again else before
            for i in range(6):
                e[i] = 0.0
                for j in range(n):
                    e[i] += J[i, j] * source[j, c]
            if not damped_step(J, e, 0.0, A, y, x):
                return 0.0
            for j in range(n):
                N[j, c] = source[j, c] - x[j]
            for b in range(c):
                along = 0.0
                for j in range(n):
                    along += N[j, b] * N[j, c]
                for j in range(n):
                    N[j, c] -= along * N[j, b]
            length = 0.0
            for j in range(n):
                length += N[j, c] * N[j, c]
            length = np.sqrt(length)
            if not length > 0.0:
                return 0.0
            least = min(least, length)
            for j in range(n):
                N[j, c] /= length
    return least


@compiled
def room(middle: float, half: float, q: float) -> tuple[float, float]:
    """First and second derivative of −ln(1 − x²), which keeps a joint away from its limits; half is infinite without."""
    if half == np.inf:
        return 0.0, 0.0
    x = (q - middle) / half
    inner = min(max(x, -EDGE), EDGE)
    rest = 1.0 - inner * inner
    curve = 2.0 * (1.0 + inner * inner) / (rest * rest)
    return (2.0 * inner / rest + curve * (x - inner)) / half, curve / (half * half)


@compiled
def carry(
    chain: Chain,
    middle: Array,
    half: Array,
    poses: Array,
    shares: Array,
    N: Array,
    way: Array,
) -> int:
    """Carry way[0] (n,) from station to station, kept off the limits; how many stations of way (k, n) are good.

    shares (k,) are the stations as shares of the path; N (n, d) holds free directions at the first.
    """
    n, d = N.shape
    J, on, other = np.empty((6, n)), np.empty((n, d)), np.empty(n)
    for k in range(1, way.shape[0]):
        way[k] = way[k - 1]
        if not come_to(chain, poses[k], way[k], J) < REACHED:
            return k
        for i in range(n):
            if not abs(way[k, i] - way[k - 1, i]) <= LARGEST_EDGE:
                return k
        if free_directions(J, N, on) == 0.0:
            continue
        N[:] = on
        largest = 1e-12
        for i in range(n):
            other[i] = 0.0
        for c in range(d):
            slope = 0.0
            for i in range(n):
                slope += N[i, c] * room(middle[i], half[i], way[k, i])[0]
            for i in range(n):
                other[i] -= ROOM * slope * N[i, c] * (shares[k] - shares[k - 1])
        for i in range(n):
            largest = max(largest, abs(other[i]))
        for i in range(n):
            other[i] = way[k, i] + other[i] * min(1.0, AWAY / largest)
        if come_to(chain, poses[k], other, J) < REACHED:
            way[k] = other
    return len(way)


@compiled
def directions(chain: Chain, way: Array, first: Array, N: Array) -> float:
    """`free_directions` (k, n, d) at configurations (k, n), each like the one before; how alike the least are."""
    n = way.shape[1]
    frame, T, J, least = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n)), 1.0
    for k in range(way.shape[0]):
        frames(chain, way[k], frame)
        tool_pose(chain, frame, T)
        jacobian_from(chain, frame, T, J)
        alike = free_directions(J, first if k == 0 else N[k - 1], N[k])
        if k > 0:
            least = min(least, alike)
    return least


@compiled
def solve_blocks(D: Array, C: Array, b: Array) -> None:
    """Solve a symmetric block tridiagonal system, in place: diagonal blocks D (k, d, d), C[i] left of D[i], right side b."""
    k, d = b.shape
    column, work = np.empty(d), np.empty((d, d))
    for i in range(1, k):
        for c in range(d):  # D[i] − C D[i − 1]⁻¹ Cᵀ, column by column
            column[:] = C[i, c]
            work[:] = D[i - 1]
            cholesky_solve(work, column)
            for r in range(d):
                b[i, c] -= column[r] * b[i - 1, r]
                for j in range(d):
                    D[i, r, c] -= C[i, r, j] * column[j]
    for i in range(k - 1, -1, -1):
        if i + 1 < k:
            for r in range(d):
                for c in range(d):
                    b[i, r] -= C[i + 1, c, r] * b[i + 1, c]
        cholesky_solve(D[i], b[i])


@compiled
def _assemble(
    middle: Array,
    half: Array,
    shares: Array,
    keep_off: float,
    held: bool,
    way: Array,
    N: Array,
    D: Array,
    C: Array,
    b: Array,
) -> None:
    """The Newton system of the cost ½ Σ |Δq|² / Δs + Σ room, in the coordinates of free motion, for `solve_blocks`."""
    k, n, d = N.shape
    pull, bend = np.empty(n), np.empty(n)
    for i in range(k):
        left = shares[i] - shares[i - 1] if i > 0 else 0.0
        right = shares[i + 1] - shares[i] if i + 1 < k else 0.0
        weight, stiff = 0.5 * keep_off * (left + right), 0.0
        for j in range(n):
            slope, curve = room(middle[j], half[j], way[i, j])
            pull[j], bend[j] = -weight * slope, weight * curve
        if i > 0:
            stiff += 1.0 / left
            for j in range(n):
                pull[j] -= (way[i, j] - way[i - 1, j]) / left
        if i + 1 < k:
            stiff += 1.0 / right
            for j in range(n):
                pull[j] += (way[i + 1, j] - way[i, j]) / right
        stays = held and i == 0
        for r in range(d):
            b[i, r] = 0.0
            for c in range(d):
                D[i, r, c] = stiff if r == c else 0.0
                C[i, r, c] = 0.0
            for j in range(n):
                b[i, r] += 0.0 if stays else N[i, j, r] * pull[j]
                for c in range(d):
                    if not stays:
                        D[i, r, c] += N[i, j, r] * bend[j] * N[i, j, c]
                    if i > 0 and not (held and i == 1):
                        C[i, r, c] -= N[i, j, r] * N[i - 1, j, c] / left


@compiled
def smooth(
    chain: Chain, middle: Array, half: Array, poses: Array, shares: Array, first: Array,
    keep_off: float, held: bool, way: Array, N: Array,
) -> float:  # fmt: skip
    """Move configurations (k, n) along their curves of solutions to the least cost of motion and room, in place.

    Newton steps in the coordinates of free motion: a block tridiagonal system, so a round takes time that grows with the
    stations only. `keep_off` is the weight of the room to the limits. The first configuration stays where `held`.
    first (n, d) are free directions there; N (k, n, d) becomes those at all. Returns how alike those of neighbours are.
    """
    k, n, d = N.shape
    D, C, b = np.empty((k, d, d)), np.empty((k, d, d)), np.empty((k, d))
    move, J = np.empty((k, n)), np.empty((6, n))
    for _ in range(ROUNDS):
        directions(chain, way, first, N)
        _assemble(middle, half, shares, keep_off, held, way, N, D, C, b)
        solve_blocks(D, C, b)
        largest = 1e-12
        for i in range(k):
            for j in range(n):
                move[i, j] = 0.0
                for r in range(d):
                    move[i, j] += N[i, j, r] * b[i, r]
                largest = max(largest, abs(move[i, j]))
        share = min(1.0, LARGEST_MOVE / largest)
        for i in range(k):
            for j in range(n):
                move[i, j] = way[i, j] + share * move[i, j]
            if come_to(chain, poses[i], move[i], J) < REACHED:
                way[i] = move[i]
        if largest < SMOOTH:
            break
    return directions(chain, way, first, N)
