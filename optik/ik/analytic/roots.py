"""Roots of a target: Newton polishing and verification of candidates, and the branch nearest to an initial guess."""

from __future__ import annotations

from math import floor, pi, sqrt

import numpy as np

from optik.compiled import compiled
from optik.ik._gauss_newton import descend_inside
from optik.kinematics import Chain, Range, error_of_pose, forward, jacobian_from, turns, workspace
from optik.linear import cholesky_solve, copy_vector
from optik.newton import GAIN, LEAST_DAMPING
from optik.task import POSE
from optik.types import Array, Flags

SAME_ROOT = 1e-5
"""Roots closer than this in every joint [rad, m] are equal: rounding separates coinciding roots by 1e-8 to 1e-6."""
LIMIT_BAND = 1e-4
"""A joint that violates its limits by at most this [rad, m] is clamped, and the others correct the error."""
SINGULAR_PIVOT = 1e-9
"""A pivot of JᵀJ below this fraction of its entry (3e-5 of a length) means that the configuration is singular."""
ROOT_ROUNDING, NEAR_ROOT = 1e-14, 1e-12
"""Position and rotation error [m, rad] to which a root is refined; a candidate within it is not changed."""
WHOLE_POSE = POSE.flags
"""Flags of the complete pose."""
POLISHING_STEPS = 40
"""Largest number of polishing steps of a candidate. Least-squares candidates near a singularity need many."""
CLAMPED_STEPS = 20
"""Largest number of steps that correct a root after clamping to a limit."""


@compiled
def refine_within(
    chain: Chain, bounds: Range, target: Array, tolerance: tuple[float, float], steps: int, q: Array
) -> tuple[int, float, float]:
    """Refine q (n,) inside bounds until it meets a target pose within a tolerance; return the result of `refine`."""
    rule = (tolerance[0], tolerance[1], float(steps), 4.0, 0.5, GAIN, LEAST_DAMPING, 1.0)
    k, _, p2, r2 = descend_inside(chain, bounds, (WHOLE_POSE.copy(), target), rule, 0, q, np.empty((0, 6)))
    return k, sqrt(p2), sqrt(r2)


@compiled
def refine(chain: Chain, bounds: Range, target: Array, steps: int, q: Array) -> tuple[int, float, float]:
    """Refine q (n,) inside bounds to a target pose, up to rounding; a candidate with errors below 1e-12 is not changed.

    Returns the number of steps, and the position and rotation errors left [m, rad].
    """
    frame, T, _ = workspace(chain, q.shape[0])
    p2, r2 = error_of_pose(chain, target, q, frame, T, np.empty(6))
    if p2 + r2 < NEAR_ROOT * NEAR_ROOT:
        return 0, sqrt(p2), sqrt(r2)
    return refine_within(chain, bounds, target, (ROOT_ROUNDING, ROOT_ROUNDING), steps, q)


@compiled
def is_same_root(chain: Chain, a: Array, b: Array) -> bool:
    """Return whether two configurations are equal up to 2π-multiples: a, b (n,) [rad, m]."""
    for i in range(a.shape[0]):
        d = a[i] - b[i]
        if turns(chain, i):
            d -= 2.0 * pi * floor(d / (2.0 * pi) + 0.5)
        if not abs(d) < SAME_ROOT:
            return False
    return True


@compiled
def is_singular(chain: Chain, bounds: Range, q: Array) -> bool:
    """Return whether a configuration is singular: the Jacobian columns of the moving joints are linearly dependent.

    Shapes and units: q (n,) [rad, m].
    """
    n, (low, high) = q.shape[0], bounds
    (frame, T, J), A, y = workspace(chain, n), np.empty((n, n)), np.zeros(n)
    forward(chain, q, frame, T)
    jacobian_from(chain, frame, T, J)
    for i in range(n):
        for j in range(i + 1):
            A[i, j] = 0.0
            for r in range(6):
                A[i, j] += J[r, i] * J[r, j]
            if (low[i] == high[i] or low[j] == high[j]) and i != j:
                A[i, j] = 0.0
        if low[i] == high[i]:
            A[i, i] = 1.0
    return not cholesky_solve(A, y, SINGULAR_PIVOT)


@compiled
def add_root(chain: Chain, bounds: Range, q: Array, roots: Array, count: int) -> bool:
    """Append a configuration with revolute joints in [−π, π) to the roots unless it is one of them; return whether it was new.

    Shapes and units: q (n,) [rad, m], roots (k, n) [rad, m] (overwritten).
    """
    low, high = bounds
    for k in range(count):
        if is_same_root(chain, q, roots[k]):
            return False
    for i in range(q.shape[0]):
        x = q[i]
        if turns(chain, i) and low[i] < high[i]:
            x -= 2.0 * pi * floor(x / (2.0 * pi) + 0.5)
        roots[count, i] = x
    return True


@compiled
def find_distinct(
    chain: Chain, bounds: Range, target: Array, tolerance: tuple[float, float],
    candidates: Array, roots: Array, singular: Flags,
) -> int:  # fmt: skip
    """Refine candidates, write the distinct ones that meet the target into roots, and return their number.

    Shapes and units: target (4, 4) [1, m], tolerance (float, float) [m, rad], candidates (m, n) [rad, m] (overwritten), roots
    (m, n) [rad, m] (overwritten), singular (m,) (overwritten).
    """
    count = 0
    for k in range(candidates.shape[0]):
        q = candidates[k]
        _, position, rotation = refine(chain, bounds, target, POLISHING_STEPS, q)
        if position <= tolerance[0] and rotation <= tolerance[1] and add_root(chain, bounds, q, roots, count):
            singular[count] = is_singular(chain, bounds, roots[count])
            count += 1
    return count


@compiled
def find_nearest_branch(
    chain: Chain, bounds: Range, limits: Range, target: Array,
    tolerance: tuple[float, float], candidates: Array, q0: Array, q: Array,
) -> tuple[int, bool, bool]:  # fmt: skip
    """Write the branch nearest to `q0` into q, and return the number of roots and the result of `choose_nearest`.

    The second flag is also true if a root is singular.

    Shapes and units: target (4, 4) [1, m], tolerance (float, float) [m, rad], candidates (m, n) [rad, m] (overwritten), q0 (n,)
    [rad, m], q (n,) [rad, m] (overwritten).
    """
    roots, singular = np.empty_like(candidates), np.empty(candidates.shape[0], np.bool_)
    count = find_distinct(chain, bounds, target, tolerance, candidates, roots, singular)
    solved, doubt = choose_nearest(chain, limits, roots[:count], q0, q)
    for k in range(count):
        doubt = doubt or singular[k]
    return count, solved, doubt


@compiled
def enumerate_roots(
    chain: Chain, bounds: Range, target: Array, tolerance: tuple[float, float],
    starts: Array, steps: int, roots: Array, patience: int,
) -> tuple[int, int]:  # fmt: skip
    """Refine seeds until `patience` consecutive ones lead to no new root; return the numbers of roots and of steps.

    Shapes and units: target (4, 4) [1, m], tolerance (float, float) [m, rad], starts (m, n) [rad, m], roots (k, n) [rad, m]
    (overwritten).
    """
    count, idle, taken = 0, 0, 0
    q = np.empty(starts.shape[1])
    for k in range(starts.shape[0]):
        if idle >= patience or count == roots.shape[0]:
            break
        copy_vector(starts[k], q)
        more, position, rotation = refine(chain, bounds, target, steps, q)
        taken += more
        idle += 1
        if position <= tolerance[0] and rotation <= tolerance[1] and add_root(chain, bounds, q, roots, count):
            count, idle = count + 1, 0
    return count, taken


@compiled
def choose_nearest(chain: Chain, limits: Range, roots: Array, q0: Array, q: Array) -> tuple[bool, bool]:
    """Write the branch nearest to `q0` into q; return whether it is inside the limits, and whether a root is near a limit.

    Shapes and units: roots (k, n) [rad, m], q0 (n,) [rad, m], q (n,) [rad, m] (overwritten).
    """
    lower, upper = limits
    turn, x = 2.0 * pi, np.empty(q.shape[0])
    least, least_out, close = np.inf, np.inf, False
    for k in range(roots.shape[0]):
        distance, out = 0.0, 0.0
        for i in range(q.shape[0]):
            v = roots[k, i]
            if turns(chain, i) and lower[i] < upper[i]:
                v += turn * floor((q0[i] - v) / turn + 0.5)
                off = max(lower[i] - v, v - upper[i])
                close = close or 0.0 < off < LIMIT_BAND
                if off > 0.0:  # the nearest winding inside, if any, is one turn towards the limits
                    other = v + turn if v < lower[i] else v - turn
                    off2 = max(lower[i] - other, other - upper[i])
                    close = close or 0.0 < off2 < LIMIT_BAND
                    v = other if off2 < off else v
            off = max(lower[i] - v, v - upper[i])
            close = close or 0.0 < off < LIMIT_BAND
            out = max(out, off)
            distance += (v - q0[i]) * (v - q0[i])
            x[i] = v
        if out <= 0.0 and (distance < least):
            least, least_out = distance, 0.0
            copy_vector(x, q)
        elif least == np.inf and out < least_out:
            least_out = out
            copy_vector(x, q)
    return least < np.inf, close


@compiled
def keep_inside(
    chain: Chain, limits: Range, target: Array, tolerance: tuple[float, float], rows: Array, good: Flags
) -> None:  # fmt: skip
    """Clamp configurations to the limits, correct their errors, and mark those that meet the target inside the limits.

    Shapes and units: target (4, 4) [1, m], tolerance (float, float) [m, rad], rows (k, n) [rad, m] (overwritten), good (k,)
    (overwritten).
    """
    lower, upper = limits
    for k in range(rows.shape[0]):
        q = rows[k]
        moved = False
        for i in range(q.shape[0]):
            moved = moved or q[i] < lower[i] or q[i] > upper[i]
            q[i] = min(max(q[i], lower[i]), upper[i])
        # no steps where nothing was clamped: only the error is measured
        _, position, rotation = refine(chain, limits, target, CLAMPED_STEPS if moved else 0, q)
        good[k] = position <= tolerance[0] and rotation <= tolerance[1]
