"""Null-space motion of redundant arms, compiled: continuation from station to station, and smoothing."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.kinematics import Chain, frames, jacobian_from, tool_pose, workspace
from optik.linear import cholesky_solve, copy_matrix, copy_vector, damped_step
from optik.se3 import pose_error
from optik.types import Array

Ranges = tuple[Array, Array]
"""Middle (n,) and half (n,) of the joints' ranges [rad, m], infinite without a limit."""
Stations = tuple[Array, Array]
"""Poses (k, 4, 4) of the tool at stations of the path [1, m], and the stations (k,) as fractions of the path [1]."""
LARGEST_EDGE = 0.7
"""Largest joint motion from one station to the next [rad or m], before smoothing: a larger one may be a jump."""
BARRIER_WEIGHT = 0.3
"""Weight of the barrier at the limits, −Σ ln(1 − x²) with x = (q − middle) / half, beside ½ the squared motion."""
LOG_EDGE = 0.98
"""The barrier continues as a parabola beyond this x, so that it has derivatives outside the limits, too."""
SMOOTHING_ROUNDS = 60
"""Most Newton steps of smoothing."""
SMOOTHING_CONVERGED = 1e-4
"""Smoothing has converged if a step moves no joint further than this [rad or m]: the guide need not be exact."""
LARGEST_MOVE = 0.2
"""Largest joint motion in one step of smoothing [rad or m], so that the null spaces change little."""
MOST_RETREAT = 0.05
"""Largest null-space motion away from the limits from one station to the next [rad or m], before smoothing."""
STATION_REACHED = 1e-9
"""Largest pose error of a configuration at its station [m, rad]."""


@compiled
def project_onto(chain: Chain, target: Array, q: Array, J: Array) -> float:
    """Project a configuration, in place, onto a pose by minimum-norm Newton steps.

    Shapes and units: target (4, 4) [m], q (n,) [rad, m], J (6, n) [m/rad, 1]. Returns [m, rad].
    """
    n = q.shape[0]
    frame, T, e, dq = np.empty((chain[0].shape[0], 4, 4)), np.empty((4, 4)), np.empty(6), np.empty(n)
    A, y, best, worst = np.empty((6, 6)), np.empty(6), np.empty(n), np.inf
    for _ in range(12):
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        pose_error(T, target, e)
        error = 0.0
        for i in range(6):
            error = max(error, abs(e[i]))
        if not error < worst:
            copy_vector(best, q)  # rounding, or no progress; J is that of one step before
            break
        worst = error
        copy_vector(q, best)
        jacobian_from(chain, frame, T, J)
        if error < 1e-14 or not damped_step(J, e, 0.0, A, y, dq):
            break
        for i in range(n):
            q[i] += dq[i]
    return worst


@compiled
def find_null_space(J: Array, before: Array, N: Array) -> float:
    """Compute an orthonormal basis of the null space that is near a given one.

    The given vectors are projected onto the null space, then orthonormalised one by one.

    Shapes and units: J (6, n) [m/rad, 1], before (n, d) [1], N (n, d) [1]. Returns [1].
    """
    n, d = before.shape
    e, A, y, x = np.empty(6), np.empty((6, 6)), np.empty(6), np.empty(n)
    least = 1.0
    for c in range(d):
        for again in range(2):  # the second time removes rounding
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
def barrier_derivatives(middle: float, half: float, q: float) -> tuple[float, float]:
    """Return the first and second derivative of the barrier −ln(1 − x²), x = (q − middle) / half.

    Shapes and units: middle, half [rad, or m], q [rad, or m].
    """
    if half == np.inf:
        return 0.0, 0.0
    x = (q - middle) / half
    inner = min(max(x, -LOG_EDGE), LOG_EDGE)
    rest = 1.0 - inner * inner
    curve = 2.0 * (1.0 + inner * inner) / (rest * rest)
    return (2.0 * inner / rest + curve * (x - inner)) / half, curve / (half * half)


@compiled
def continue_stations(
    chain: Chain, middle: Array, half: Array, poses: Array, fractions: Array, N: Array, way: Array
) -> int:
    """Continue a configuration from station to station by minimum-norm steps, kept away from the limits.

    Shapes and units: middle, half (n,) [rad, m], poses (k, 4, 4) [m], fractions (k,) [1], N (n, d) [1], way (k, n) [rad, m].
    """
    n, d = N.shape
    J, on, other = np.empty((6, n)), np.empty((n, d)), np.empty(n)
    for k in range(1, way.shape[0]):
        way[k] = way[k - 1]
        if not project_onto(chain, poses[k], way[k], J) < STATION_REACHED:
            return k
        for i in range(n):
            if not abs(way[k, i] - way[k - 1, i]) <= LARGEST_EDGE:
                return k
        if find_null_space(J, N, on) == 0.0:
            continue
        copy_matrix(on, N)
        largest = 1e-12
        for i in range(n):
            other[i] = 0.0
        for c in range(d):
            slope = 0.0
            for i in range(n):
                slope += N[i, c] * barrier_derivatives(middle[i], half[i], way[k, i])[0]
            for i in range(n):
                other[i] -= BARRIER_WEIGHT * slope * N[i, c] * (fractions[k] - fractions[k - 1])
        for i in range(n):
            largest = max(largest, abs(other[i]))
        for i in range(n):
            other[i] = way[k, i] + other[i] * min(1.0, MOST_RETREAT / largest)
        if project_onto(chain, poses[k], other, J) < STATION_REACHED:
            way[k] = other
    return len(way)


@compiled
def find_null_spaces(chain: Chain, way: Array, first: Array, N: Array) -> float:
    """Compute bases of the null spaces at configurations, each near the one before.

    Shapes and units: way (k, n) [rad, m], first (n, d) [1], N (k, n, d) [1]. Returns [1].
    """
    n = way.shape[1]
    (frame, T, J), least = workspace(chain, n), 1.0
    for k in range(way.shape[0]):
        frames(chain, way[k], frame)
        tool_pose(chain, frame, T)
        jacobian_from(chain, frame, T, J)
        alike = find_null_space(J, first if k == 0 else N[k - 1], N[k])
        if k > 0:
            least = min(least, alike)
    return least


@compiled
def solve_block_tridiagonal(D: Array, C: Array, b: Array) -> None:
    """Solve a symmetric positive definite block tridiagonal system, in place.

    Shapes and units: D (k, d, d) [1] (overwritten), C (k, d, d) [1], b (k, d) [1].
    """
    k, d = b.shape
    column, work = np.empty(d), np.empty((d, d))
    for i in range(1, k):
        for c in range(d):  # D[i] − C D[i − 1]⁻¹ Cᵀ, column by column
            copy_vector(C[i, c], column)
            copy_matrix(D[i - 1], work)
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
    ranges: Ranges, fractions: Array, keep_off: float, held: bool, way: Array, N: Array, system: tuple[Array, Array, Array]
) -> None:  # fmt: skip
    """Write the system of the cost ½ Σ |Δq|² / Δs + Σ barrier in null-space coordinates for `solve_block_tridiagonal`."""
    (k, n, d), (middle, half), (D, C, b) = N.shape, ranges, system
    pull, bend = np.empty(n), np.empty(n)
    for i in range(k):
        left = fractions[i] - fractions[i - 1] if i > 0 else 0.0
        right = fractions[i + 1] - fractions[i] if i + 1 < k else 0.0
        weight, stiff = 0.5 * keep_off * (left + right), 0.0
        for j in range(n):
            slope, curve = barrier_derivatives(middle[j], half[j], way[i, j])
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
    chain: Chain, ranges: Ranges, stations: Stations, first: Array, keep_off: float, held: bool, way: Array, N: Array
) -> float:  # fmt: skip
    """Move configurations, in place, along their self-motion manifolds to the least cost of motion and barrier.

    By Newton steps in null-space coordinates: the system is block tridiagonal, so the time grows linearly with the stations.

    Shapes and units: first (n, d) [1], keep_off [1], way (k, n) [rad, m], N (k, n, d) [1]. Returns [1].
    """
    (k, n, d), (poses, fractions) = N.shape, stations
    D, C, b = np.empty((k, d, d)), np.empty((k, d, d)), np.empty((k, d))
    move, J = np.empty((k, n)), np.empty((6, n))
    for _ in range(SMOOTHING_ROUNDS):
        find_null_spaces(chain, way, first, N)
        _assemble(ranges, fractions, keep_off, held, way, N, (D, C, b))
        solve_block_tridiagonal(D, C, b)
        largest = 1e-12
        for i in range(k):
            for j in range(n):
                move[i, j] = 0.0
                for r in range(d):
                    move[i, j] += N[i, j, r] * b[i, r]
                largest = max(largest, abs(move[i, j]))
        step = min(1.0, LARGEST_MOVE / largest)
        for i in range(k):
            for j in range(n):
                move[i, j] = way[i, j] + step * move[i, j]
            if project_onto(chain, poses[i], move[i], J) < STATION_REACHED:
                way[i] = move[i]
        if largest < SMOOTHING_CONVERGED:
            break
    return find_null_spaces(chain, way, first, N)
