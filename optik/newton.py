"""Newton polishing: configurations that meet poses to rounding, and their derivatives along a motion."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.kinematics import Chain, error_of_pose, forward, jacobian_from, tool_motion, workspace
from optik.linear import copy_vector, damped_step, qr_factor, qr_solve, smallest_of_factor, smallest_singular_value
from optik.types import Array

GAIN = 0.1
"""Gain [1] of the damping λ² = gain · ½|e|² + least damping of searches from a distant seed (Sugihara 2011)."""
LEAST_DAMPING = 1e-12
"""Least damping λ² [m², rad²]: 1e-8 would leave 0.2 % of near targets unsolved, 1e-4 would leave 5 %."""
POLISHING_DAMPING = 1e-4
"""Damping λ at a singular configuration [m, rad]: a step leaves 1e-4 of the error in directions with a singular value of
100 λ."""
SQUARED_ROUNDING = 1e-30
"""Squared error [m², rad²] that is rounding."""


@compiled
def _stack(J: Array, rows: Array, A: Array) -> None:
    """Write [J; rows] into A (6 + d, n)."""
    for j in range(A.shape[1]):
        for i in range(6):
            A[i, j] = J[i, j]
        for i in range(rows.shape[0]):
            A[6 + i, j] = rows[i, j]


@compiled
def _residual(rows: Array, values: Array, q: Array, e: Array) -> tuple[float, float]:
    """Write values − rows · q behind the pose error in e (6 + d,); return the square and the largest entry of e."""
    for i in range(rows.shape[0]):
        e[6 + i] = values[i]
        for j in range(q.shape[0]):
            e[6 + i] -= rows[i, j] * q[j]
    size, largest = 0.0, 0.0
    for i in range(e.shape[0]):
        size += e[i] * e[i]
        largest = max(largest, abs(e[i]))
    return size, largest


@compiled
def polish(chain: Chain, target: Array, rows: Array, values: Array, steps: int, q: Array) -> tuple[float, float]:
    """Polish a configuration to a target pose and rows · q = values, by undamped Newton steps until rounding.

    Steps are least-squares solutions for more equations than joints, and of least norm for fewer.

    Shapes and units: target (4, 4) [1, m], rows (d, n) [1], values (d,) [rad, m], q (n,) [rad, m] (overwritten). Returns worst
    [m, rad], rank  [1].
    """
    n, d = q.shape[0], rows.shape[0]
    frame, T, J = workspace(chain, n)
    shortest = d == 0 and n > 6
    A, beta, order = np.empty((6 + d, 6 if shortest else n)), np.empty(n), np.empty(n, np.int64)
    e, dq, best = np.empty(6 + d), np.empty(n), q.copy()
    smallest, worst, rank = np.inf, np.inf, 1.0
    for _ in range(steps + 1):
        error_of_pose(chain, target, q, frame, T, e)
        size, largest = _residual(rows, values, q, e)
        if not size < smallest:
            break
        before, smallest, worst = smallest, size, largest
        copy_vector(q, best)
        # quadratic convergence: after an error below 1e-9 the result is exact to rounding
        if size < SQUARED_ROUNDING or (before < 1e-18 and size < 1e-26):
            break
        jacobian_from(chain, frame, T, J)
        if shortest:
            if not damped_step(J, e, 0.0, A, beta[:6], dq):
                break
        else:
            _stack(J, rows, A)
            rank = qr_factor(A, beta, order)
            if rank == 0.0:
                break
            qr_solve(A, beta, order, e, dq)
        for i in range(n):
            q[i] += dq[i]
    copy_vector(best, q)
    return worst, rank


@compiled
def polish_batch(chain: Chain, q: Array, targets: Array, steps: int) -> None:
    """Polish many configurations to their target poses: q (k, n) [rad, m] (overwritten), targets (k, 4, 4) [1, m]."""
    no_rows, no_values = np.empty((0, q.shape[1])), np.empty(0)
    for k in range(q.shape[0]):
        polish(chain, targets[k], no_rows, no_values, steps, q[k])


@compiled
def _leibniz(k: int, rows: Array, values: Array, q: Array, dq: Array, out: Array) -> None:
    """Write the derivative of order k + 1 of values − rows · q without its term rows · q⁽ᵏ⁺¹⁾ into out (d,)."""
    for i in range(rows.shape[1]):
        out[i] = values[k + 1, i]
        for j in range(q.shape[0]):
            part = rows[k + 1, i, j] * q[j]
            if k == 1:
                part += 2.0 * rows[1, i, j] * dq[0, j]
            elif k == 2:
                part += 3.0 * (rows[2, i, j] * dq[0, j] + rows[1, i, j] * dq[1, j])
            out[i] -= part


@compiled
def derivatives_at(
    chain: Chain, q: Array, twists: Array, rows: Array, values: Array, dq: Array,
    floor: float = np.inf,
) -> tuple[float, float]:  # fmt: skip
    """Write the first three joint derivatives of a motion with known tool twists V and rows(s) · q(s) = values(s).

    They solve J q' = V, J q'' = V' − J' q', and so on.

    Shapes and units: q (n,) [rad, m], twists (3, 6) [m, rad], rows (4, d, n) [1], values (4, d) [rad, m], dq (3, n) [rad, m]
    (overwritten). Returns rank  [1], singular  [m/rad, 1].
    """
    n, d = q.shape[0], rows.shape[1]
    frame, T, J = workspace(chain, n)
    A, beta, order = np.empty((6 + d, n)), np.empty(n), np.empty(n, np.int64)
    e, known = np.empty(6 + d), np.empty((3, 6))
    forward(chain, q, frame, T)
    jacobian_from(chain, frame, T, J)
    _stack(J, rows[0], A)
    rank = qr_factor(A, beta, order)
    singular = 0.0
    if d > 0:
        singular = smallest_singular_value(J, floor)
    elif rank > 0.0:  # A is J
        singular = smallest_of_factor(A, floor)
    for k in range(3):
        for i in range(n):
            dq[k, i] = 0.0
    if rank == 0.0:
        return rank, singular
    for k in range(3):
        if k > 0:
            tool_motion(chain, frame, T, q, dq, known)
        for i in range(6):
            e[i] = twists[k, i] - (known[k, i] if k > 0 else 0.0)
        _leibniz(k, rows, values, q, dq, e[6:])
        qr_solve(A, beta, order, e, dq[k])
    return rank, singular


@compiled
def polish_damped(chain: Chain, target: Array, twist: Array, steps: int, q: Array, v: Array) -> float:
    """Polish a configuration to a target pose, and its velocity to a twist, by damped steps near a singular configuration.

    Null-space components of both stay unchanged.

    Shapes and units: target (4, 4) [1, m], twist (6,) [m, rad], q (n,) [rad, m] (overwritten), v (n,) [rad, m] (overwritten).
    Returns [m, rad].
    """
    n = q.shape[0]
    frame, T, J = workspace(chain, n)
    A, y, dq, e = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6)
    worst = 0.0
    for step in range(2 * steps):
        of_pose = step < steps
        error_of_pose(chain, target, q, frame, T, e)
        jacobian_from(chain, frame, T, J)
        if not of_pose:
            for i in range(6):
                e[i] = twist[i]
                for j in range(n):
                    e[i] -= J[i, j] * v[j]
        if step == steps - 1 or step == 2 * steps - 1:
            for i in range(6):
                worst = max(worst, abs(e[i]))
            continue
        if not damped_step(J, e, POLISHING_DAMPING * POLISHING_DAMPING, A, y, dq, 0.0):
            return np.inf
        for j in range(n):
            if of_pose:
                q[j] += dq[j]
            else:
                v[j] += dq[j]
    return worst
