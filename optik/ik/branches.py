"""From the roots of a target to branches: polishing, 2π-multiples, limits, and points on curves of roots.

A *root* is a configuration that meets the target, with revolute joints in [−π, π), regardless of the limits. A *branch* is
a root plus 2π-multiples, inside the limits. At a singular configuration a root may be one point of a curve of roots (a
straight wrist determines only q4 + q6). Each piece of the curve inside the limits is then represented by its point nearest
to a reference. Configurations are compared joint by joint, revolute joints modulo 2π.
"""

from __future__ import annotations

from itertools import combinations, product
from math import floor, pi, sqrt

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik._gauss_newton import descend_inside
from optik.ik._null_space import FRACTION_OF_TOLERANCE, descend
from optik.kinematics import Chain, Range, error_of_pose, forward, jacobian_from, turns_whole, workspace
from optik.linear import cholesky_solve, copy_vector
from optik.newton import GAIN, LEAST_DAMPING
from optik.task import POSE
from optik.types import Array, Flags

# ---------------- roots of a target


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
    """Refine q (n,) inside bounds until it meets a target pose within a tolerance; return the result of `refine_root`."""
    rule = (tolerance[0], tolerance[1], float(steps), 4.0, 0.5, GAIN, LEAST_DAMPING, 1.0)
    k, _, p2, r2 = descend_inside(chain, bounds, (WHOLE_POSE.copy(), target), rule, 0, q, np.empty((0, 6)))
    return k, sqrt(p2), sqrt(r2)


@compiled
def refine_root(chain: Chain, bounds: Range, target: Array, steps: int, q: Array) -> tuple[int, float, float]:
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
        if turns_whole(chain, i):
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
        if turns_whole(chain, i) and low[i] < high[i]:
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
        _, position, rotation = refine_root(chain, bounds, target, POLISHING_STEPS, q)
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
        more, position, rotation = refine_root(chain, bounds, target, steps, q)
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
            if turns_whole(chain, i) and lower[i] < upper[i]:
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
        _, position, rotation = refine_root(chain, limits, target, CLAMPED_STEPS if moved else 0, q)
        good[k] = position <= tolerance[0] and rotation <= tolerance[1]


# ---------------- from roots to branches


ROOT_ERROR = 1e-9
"""If one root is this accurate [m, rad], less accurate roots are rejected; near a singularity many are within the tolerance."""
MOST_WINDINGS = 4096
"""Largest number of windings of one root: joints that can turn a hundred times would otherwise have millions."""
FEW_POINTS = 4
"""Number of initial guesses on a curve of roots if only its nearest point is needed."""
CURVE_STEP = 0.05
"""Step along a null-space direction that tests whether the curve of roots continues there [rad]."""
CURVE_TRIES = 8
"""Number of directions tried from one null-space direction, each nearer to the tangent of the curve."""
DISTANCE_OBJECTIVE = np.array([1.0, 0.0, 0.0])
"""Weights [1] of the objective of `slide`: the distance to the reference alone."""


def windings(
    robot: Robot, q: Array, reference: Array, joints: Flags, *, slack: float = LIMIT_BAND, each: int = MOST_WINDINGS
) -> Array:
    """Return the configurations with 2π-multiples added to some joints, nearest to a reference first."""
    columns = [_find_turns(robot, i, q[i], reference[i], slack)[:each] if joints[i] else [q[i]] for i in range(robot.n)]
    while np.prod([float(len(c)) for c in columns]) > MOST_WINDINGS:
        max(columns, key=len).pop()
    rows = np.array(list(product(*columns)), dtype=np.float64).reshape(-1, robot.n)
    ordered: Array = rows[np.linalg.norm(rows - reference, axis=1).argsort(kind="stable")]
    return ordered


def _find_turns(robot: Robot, i: int, x: float, near: float, slack: float) -> list[float]:
    """Return the values x + 2πk of joint i inside its limits, nearest to `near` first."""
    turn, low, high = 2.0 * pi, robot.limits.lower[i] - slack, robot.limits.upper[i] + slack
    if not robot.turning[i] or robot.limits.lower[i] == robot.limits.upper[i]:
        return [x] if low <= x <= high else []
    first, last = np.ceil((low - x) / turn), np.floor((high - x) / turn)
    if np.isinf(low) or np.isinf(high):
        first = last = min(max(np.round((near - x) / turn), first), last)
    first, last = max(first, last - MOST_WINDINGS), min(last, first + MOST_WINDINGS)
    return sorted((x + turn * k for k in range(int(first), int(last) + 1)), key=lambda v: abs(v - near))


def has_too_many_windings(robot: Robot) -> bool:
    """Return whether `windings` omits some windings of this arm."""
    limits = robot.limits
    ends = np.isfinite(limits.lower) & np.isfinite(limits.upper) & robot.turning
    return bool(np.prod(np.floor((limits.upper - limits.lower)[ends] / (2.0 * pi)) + 1.0) > MOST_WINDINGS)


def select_inside(robot: Robot, target: Array, tolerance: tuple[float, float], rows: Array) -> Array:
    """Return the configurations that meet a target inside the limits, after correcting violations up to `LIMIT_BAND`."""
    rows, good = np.array(rows), np.empty(len(rows), np.bool_)
    limits = robot.limits
    keep_inside(robot.chain, (limits.lower, limits.upper), target, tolerance, rows, good)
    return rows[good if robot.motors is None else good & limits.contains(rows)]


# ---------------------------------------------------------------- curves of roots


def null_space_basis(robot: Robot, q: Array) -> Array:
    """Return an orthonormal basis (n, k) of the joint motions that do not move the tool to first order."""
    moving = robot.limits.lower < robot.limits.upper
    _, sigma, Vt = np.linalg.svd(robot.jacobian(q)[:, moving])
    rank = int((sigma > sqrt(SINGULAR_PIVOT) * sigma[0]).sum())
    out = np.zeros((robot.n, Vt.shape[0] - rank))
    out[moving] = Vt[rank:].T
    return out


def find_curve_joints(robot: Robot, target: Array, free: Range, q: Array, tolerance: tuple[float, float]) -> Flags:
    """Return which joints move along the curve of roots through a configuration; none if the root is isolated.

    If the null space has several dimensions, the tangent of the curve is a combination of the basis. A root that is found
    off the tested direction gives the next direction to test.
    """
    moves = np.zeros(robot.n, dtype=np.bool_)
    lost = list(null_space_basis(robot, q).T)
    between = [(a + sign * b) / sqrt(2.0) for a, b in combinations(lost, 2) for sign in (1.0, -1.0)]
    for along in [*lost, *between]:
        for d in (along, -along):
            for _ in range(CURVE_TRIES):
                ahead = q + CURVE_STEP * d
                x = ahead.copy()
                # stop at the tolerance: refinement to rounding would move the point along the curve
                _, position, rotation = refine_within(robot.chain, free, target, tolerance, POLISHING_STEPS, x)
                went = float(np.linalg.norm(x - q))
                if position > tolerance[0] or rotation > tolerance[1] or not 0.2 * CURVE_STEP < went < 5.0 * CURVE_STEP:
                    break  # no root, the way back, or another branch
                if np.linalg.norm(x - ahead) < 0.2 * CURVE_STEP:
                    moves |= np.abs(x - q) > 1e-3 * CURVE_STEP
                    break
                d = (x - q) / went
    return moves


def slide(robot: Robot, target: Array, q: Array, reference: Array, tolerance: tuple[float, float]) -> Array:
    """Return the root inside the limits that is nearest to a reference along the curve of roots through a configuration."""
    limits, x = (robot.limits.lower, robot.limits.upper), robot.limits.clip(q)
    refine_root(robot.chain, limits, target, CLAMPED_STEPS, x)
    within = tolerance[0] / FRACTION_OF_TOLERANCE, tolerance[1] / FRACTION_OF_TOLERANCE
    descend(robot.chain, limits, (POSE.flags, target), within, (DISTANCE_OBJECTIVE, reference), x)
    if max(tolerance) <= ROOT_ERROR:  # a curve within a larger tolerance has few exact roots
        refine_root(robot.chain, limits, target, CLAMPED_STEPS, x)
    return x


def find_curve_points(
    robot: Robot, target: Array, tolerance: tuple[float, float], q: Array, moves: Flags, reference: Array, known: Array,
    few: bool,
) -> Array:  # fmt: skip
    """Return one configuration of each piece inside the limits of the curve of roots through a configuration.

    Sliding starts from windings up to half a turn outside the limits, so that no piece is missed unless `few` is set.
    """
    each = 2 if few else MOST_WINDINGS
    starts = windings(robot, q, reference, moves, slack=pi + LIMIT_BAND, each=each)[: FEW_POINTS if few else None]
    still = windings(robot, q, reference, ~moves, each=each)
    points = np.empty((0, robot.n))
    for first, start in enumerate(starts if len(still) else ()):
        point = slide(robot, target, np.where(moves, start, still[0]), reference, tolerance)[None]
        point = select_inside(robot, target, tolerance, point)
        if first == 0 and len(point) and is_among(point[0], known):
            break
        if len(point) and not is_among(point[0], points):
            points = np.vstack([points, point])
    rows = [np.where(moves, point, others) for point in points for others in still]
    return select_inside(robot, target, tolerance, np.array(rows).reshape(-1, robot.n))


def is_among(q: Array, rows: Array) -> bool:
    """Return whether a configuration is among others (k, n), where 2π-multiples differ."""
    return bool(len(rows) and np.abs(rows - q).max(axis=1).min() < 10.0 * SAME_ROOT)


@compiled
def mark_first(rows: Array, first: Flags) -> None:
    """Mark the rows that have no equal row before them, where 2π-multiples differ.

    Shapes and units: rows (k, n) [rad, m], first (k,) (overwritten).
    """
    for k in range(rows.shape[0]):
        first[k] = True
        for j in range(k):
            far = 0.0
            for i in range(rows.shape[1]):
                far = max(far, abs(rows[k, i] - rows[j, i]))
            if first[j] and far < 10.0 * SAME_ROOT:
                first[k] = False
                break


def unique(rows: Array) -> Array:
    """Return the distinct configurations."""
    first = np.empty(len(rows), np.bool_)
    mark_first(rows, first)
    return rows[first]
