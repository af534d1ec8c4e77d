"""From candidates to branches: polish, check, merge, wind, and at a singularity slide to the point that is asked for.

A *root* is a configuration that meets the target, revolute joints in [−π, π), limits aside; a *branch* is a root with
whole turns added, inside the limits. Where the Jacobian has lost rank a root may be one point of a curve of roots (a
straight wrist fixes only q4 + q6): each piece of the curve inside the limits is then represented by one point, the one
nearest to a reference. All configurations are compared joint by joint, revolute ones around the circle.
"""

from __future__ import annotations

from itertools import combinations, product
from math import floor, pi, sqrt

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik._preference import descend
from optik.kinematics import Chain, copy_vector, frames, jacobian_from, tool_pose
from optik.linear import cholesky_solve, damped_step
from optik.se3 import pose_error
from optik.task import POSE
from optik.types import Array, Flags

SAME = 1e-5
"""Roots nearer than this on every joint are one: where two of them meet, rounding parts them by 1e-8 to 1e-6."""

BAND = 1e-4
"""A joint so little outside its limits is put on the limit, and the rest moved until the target is met again."""

FLAT = 1e-9
"""A pivot of JᵀJ below this share of its entry (3e-5 of a length) is a singularity, to be looked at with care."""

GAIN, LEAST_DAMPING = 0.1, 1e-12
"""Of the damping λ² = gain · ½|e|² + least, as in `lm`."""

MOST_WINDINGS = 4096
"""Of one root: joints that turn a hundred times would otherwise have millions."""

FEW = 4
"""Starts on a curve of roots that are enough where only its nearest point is asked for."""

CLOSE = 1e-9
"""Error of a root at most [m, rad], where there are such: beside a singularity much else is within a solver's tolerance."""

STEP = 0.05
"""How far along a lost direction to look whether the roots go on there [rad]."""

LOOKS = 8
"""Directions tried from one lost direction: each is nearer to the curve's than the one before."""


# ---------------------------------------------------------------- roots


@compiled
def push(J: Array, e: Array, damping2: float, low: Array, high: Array, q: Array, dq: Array) -> bool:
    """One damped step into dq (n,); joints that it would push through their bounds are left out of it; J is spoilt."""
    A, y = np.empty((6, 6)), np.empty(6)
    n = q.shape[0]
    for _ in range(n):
        if not damped_step(J, e, damping2, A, y, dq, 0.0):
            return False
        pushed = False
        for i in range(n):
            if (dq[i] < 0.0 and q[i] <= low[i]) or (dq[i] > 0.0 and q[i] >= high[i]):
                dq[i] = 0.0
                for r in range(6):
                    pushed = pushed or J[r, i] != 0.0
                    J[r, i] = 0.0
        if not pushed:
            return True
    return True


@compiled
def refine(chain: Chain, low: Array, high: Array, target: Array, steps: int, q: Array) -> tuple[int, float, float]:
    """Damped Gauss–Newton from q (n,), in place, within bounds, to rounding or until it gets no further.

    Returns (steps taken, position error, rotation error).
    """
    n = q.shape[0]
    frame, T, J, e = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n)), np.empty(6)
    dq, best = np.empty(n), q.copy()
    least, position, rotation, stalls, k = np.inf, np.inf, np.inf, 0, 0
    while True:
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        pose_error(T, target, e)
        p2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
        r2 = e[3] * e[3] + e[4] * e[4] + e[5] * e[5]
        size = p2 + r2
        stalls = 0 if size < 0.5 * least else stalls + 1
        if size < least:
            least, position, rotation = size, sqrt(p2), sqrt(r2)
            copy_vector(q, best)
        # to 1e-14; what comes with 1e-12 is not touched
        if least < 1e-28 or (k == 0 and least < 1e-24) or stalls == 4 or k == steps or not size < np.inf:
            copy_vector(best, q)
            return k, position, rotation
        jacobian_from(chain, frame, T, J)
        if not push(J, e, 0.5 * GAIN * size + LEAST_DAMPING, low, high, q, dq):
            copy_vector(best, q)
            return k, position, rotation
        for i in range(n):
            q[i] = min(max(q[i] + dq[i], low[i]), high[i])
        k += 1


@compiled
def same(chain: Chain, a: Array, b: Array) -> bool:
    """Whether two configurations (n,) are one, whole turns aside."""
    _fixed, prismatic, _tool = chain
    for i in range(a.shape[0]):
        d = a[i] - b[i]
        if not prismatic[i]:
            d -= 2.0 * pi * floor(d / (2.0 * pi) + 0.5)
        if not abs(d) < SAME:
            return False
    return True


@compiled
def flat(chain: Chain, low: Array, high: Array, q: Array) -> bool:
    """Whether the columns of the Jacobian at q (n,), of the joints that can move, depend on each other."""
    n = q.shape[0]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    A, y = np.empty((n, n)), np.zeros(n)
    frames(chain, q, frame)
    tool_pose(chain, frame, T)
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
    return not cholesky_solve(A, y, FLAT)


@compiled
def add_root(chain: Chain, low: Array, high: Array, q: Array, roots: Array, count: int) -> bool:
    """Write q (n,), turned into [−π, π), at the end of the roots (k, n), unless it is one of the first count."""
    _fixed, prismatic, _tool = chain
    for k in range(count):
        if same(chain, q, roots[k]):
            return False
    for i in range(q.shape[0]):
        x = q[i]
        if not prismatic[i] and low[i] < high[i]:
            x -= 2.0 * pi * floor(x / (2.0 * pi) + 0.5)
        roots[count, i] = x
    return True


@compiled
def distinct(
    chain: Chain, low: Array, high: Array, target: Array, tolerance_p: float,
    tolerance_r: float, candidates: Array, roots: Array, singular: Flags,
) -> int:  # fmt: skip
    """Refine candidates (m, n) and write those that meet the target into roots (m, n), each once; their number."""
    count = 0
    for k in range(candidates.shape[0]):
        q = candidates[k]
        _, position, rotation = refine(chain, low, high, target, 40, q)
        if position <= tolerance_p and rotation <= tolerance_r and add_root(chain, low, high, q, roots, count):
            singular[count] = flat(chain, low, high, roots[count])
            count += 1
    return count


@compiled
def regular_answer(
    chain: Chain, low: Array, high: Array, lower: Array, upper: Array, target: Array,
    tolerance_p: float, tolerance_r: float, candidates: Array, q0: Array, q: Array,
) -> tuple[int, bool, bool]:  # fmt: skip
    """`distinct` and `nearest` at once: the branch nearest to q0 (n,) into q; candidates (m, n) are refined.

    Returns (number of roots, whether q is inside, whether there is a doubt: a singular root, or one on a limit).
    """
    roots, singular = np.empty_like(candidates), np.empty(candidates.shape[0], np.bool_)
    count = distinct(chain, low, high, target, tolerance_p, tolerance_r, candidates, roots, singular)
    solved, doubt = nearest(chain, lower, upper, roots[:count], q0, q)
    for k in range(count):
        doubt = doubt or singular[k]
    return count, solved, doubt


@compiled
def enumerate_roots(
    chain: Chain, low: Array, high: Array, target: Array, tolerance_p: float,
    tolerance_r: float, starts: Array, steps: int, roots: Array, patience: int,
) -> tuple[int, int]:  # fmt: skip
    """Refine from starts (m, n) until `patience` in a row found nothing new, or roots (k, n) is full.

    Returns (number of roots, steps taken).
    """
    count, idle, taken = 0, 0, 0
    q = np.empty(starts.shape[1])
    for k in range(starts.shape[0]):
        if idle >= patience or count == roots.shape[0]:
            break
        copy_vector(starts[k], q)
        more, position, rotation = refine(chain, low, high, target, steps, q)
        taken += more
        idle += 1
        if position <= tolerance_p and rotation <= tolerance_r and add_root(chain, low, high, q, roots, count):
            count, idle = count + 1, 0
    return count, taken


# ---------------------------------------------------------------- windings and limits


@compiled
def nearest(chain: Chain, lower: Array, upper: Array, roots: Array, q0: Array, q: Array) -> tuple[bool, bool]:
    """Write the branch nearest to q0 (n,) into q; q0 stands inside the limits.

    Where no root has a winding inside, q is the one whose nearest windings stand least outside. Returns (whether q is
    inside, whether some root stands on a limit but for rounding).
    """
    _fixed, prismatic, _tool = chain
    turn, x = 2.0 * pi, np.empty(q.shape[0])
    least, least_out, close = np.inf, np.inf, False
    for k in range(roots.shape[0]):
        distance, out = 0.0, 0.0
        for i in range(q.shape[0]):
            v = roots[k, i]
            if not prismatic[i] and lower[i] < upper[i]:
                v += turn * floor((q0[i] - v) / turn + 0.5)
                off = max(lower[i] - v, v - upper[i])
                close = close or 0.0 < off < BAND
                if off > 0.0:  # the nearest inside is the first one inside, if there is one
                    other = v + turn if v < lower[i] else v - turn
                    off2 = max(lower[i] - other, other - upper[i])
                    close = close or 0.0 < off2 < BAND
                    v = other if off2 < off else v
            off = max(lower[i] - v, v - upper[i])
            close = close or 0.0 < off < BAND
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
    chain: Chain, lower: Array, upper: Array, target: Array, tolerance_p: float,
    tolerance_r: float, rows: Array, good: Flags,
) -> None:  # fmt: skip
    """Bring rows (k, n) that are out by a band onto their limits, in place, and say which meet the target inside."""
    for k in range(rows.shape[0]):
        q = rows[k]
        moved = False
        for i in range(q.shape[0]):
            moved = moved or q[i] < lower[i] or q[i] > upper[i]
            q[i] = min(max(q[i], lower[i]), upper[i])
        # no steps where nothing moved: the error alone
        _, position, rotation = refine(chain, lower, upper, target, 20 if moved else 0, q)
        good[k] = position <= tolerance_p and rotation <= tolerance_r


def windings(
    robot: Robot, q: Array, reference: Array, joints: Flags, *, slack: float = BAND, each: int = MOST_WINDINGS
) -> Array:
    """All configurations (k, n) that are q (n,) with whole turns added to some joints, nearest to the reference first.

    These joints stand inside their limits or are out by the slack. One without an end has a single winding: that nearest
    to the reference; the others the `each` nearest. Where there are too many, the farthest are left out.
    """
    columns = [_turned(robot, i, q[i], reference[i], slack)[:each] if joints[i] else [q[i]] for i in range(robot.n)]
    while np.prod([float(len(c)) for c in columns]) > MOST_WINDINGS:
        max(columns, key=len).pop()
    rows = np.array(list(product(*columns)), dtype=np.float64).reshape(-1, robot.n)
    ordered: Array = rows[np.linalg.norm(rows - reference, axis=1).argsort(kind="stable")]
    return ordered


def _turned(robot: Robot, i: int, x: float, near: float, slack: float) -> list[float]:
    """Values that joint i can have for x: the nearest first."""
    turn, low, high = 2.0 * pi, robot.limits.lower[i] - slack, robot.limits.upper[i] + slack
    if robot.prismatic[i] or robot.limits.lower[i] == robot.limits.upper[i]:
        return [x] if low <= x <= high else []
    first, last = np.ceil((low - x) / turn), np.floor((high - x) / turn)
    if np.isinf(low) or np.isinf(high):
        first = last = min(max(np.round((near - x) / turn), first), last)
    first, last = max(first, last - MOST_WINDINGS), min(last, first + MOST_WINDINGS)
    return sorted((x + turn * k for k in range(int(first), int(last) + 1)), key=lambda v: abs(v - near))


def too_many(robot: Robot) -> bool:
    """Whether `windings` leaves some out for this arm."""
    limits = robot.limits
    ends = np.isfinite(limits.lower) & np.isfinite(limits.upper) & ~robot.prismatic
    return bool(np.prod(np.floor((limits.upper - limits.lower)[ends] / (2.0 * pi)) + 1.0) > MOST_WINDINGS)


def inside(robot: Robot, target: Array, tolerance: tuple[float, float], rows: Array) -> Array:
    """Those of rows (k, n) that meet the target inside the limits, brought onto a limit that they miss by the band."""
    rows, good = np.array(rows), np.empty(len(rows), np.bool_)
    limits = robot.limits
    keep_inside(
        robot.chain, limits.lower, limits.upper, target, *tolerance, rows, good
    )  # fmt: skip
    return rows[good]


# ---------------------------------------------------------------- curves of roots


def lost_directions(robot: Robot, q: Array) -> Array:
    """Directions (n, d) of joint motion at q (n,) that leave the tool where it is, to first order."""
    moving = robot.limits.lower < robot.limits.upper
    _, sigma, Vt = np.linalg.svd(robot.jacobian(q)[:, moving])
    rank = int((sigma > sqrt(FLAT) * sigma[0]).sum())
    out = np.zeros((robot.n, Vt.shape[0] - rank))
    out[moving] = Vt[rank:].T
    return out


def goes_on(robot: Robot, target: Array, free: tuple[Array, Array], q: Array) -> Flags:
    """Which joints move along the curve of roots through q (n,); none where q stands alone (an elbow, stretched).

    Where more than one direction is lost, the curve leaves along some mixture of them: a root met off the direction in
    which it was looked for says which, and there it is looked for next.
    """
    moves = np.zeros(robot.n, dtype=np.bool_)
    lost = list(lost_directions(robot, q).T)
    between = [(a + sign * b) / sqrt(2.0) for a, b in combinations(lost, 2) for sign in (1.0, -1.0)]
    for along in [*lost, *between]:
        for d in (along, -along):
            for _ in range(LOOKS):
                ahead = q + STEP * d
                x = ahead.copy()
                _, position, rotation = refine(robot.chain, *free, target, 40, x)
                went = float(np.linalg.norm(x - q))
                if max(position, rotation) > 1e-11 or not 0.2 * STEP < went < 5.0 * STEP:
                    break  # no root, the way back, or another branch
                if np.linalg.norm(x - ahead) < 0.2 * STEP:
                    moves |= np.abs(x - q) > 1e-3 * STEP
                    break
                d = (x - q) / went
    return moves


def slide(robot: Robot, target: Array, q: Array, reference: Array) -> Array:
    """Bring q (n,) inside the limits, and along its curve of roots to where it is nearest to the reference."""
    lower, upper = robot.limits.lower, robot.limits.upper
    x = robot.limits.clip(q)
    refine(robot.chain, lower, upper, target, 20, x)
    numbers = np.array([1.0, 0.0, 0.0, 1e-10, 1e-10])
    descend(robot.chain, lower, upper, POSE.flags, target, numbers, reference, x)
    refine(robot.chain, lower, upper, target, 20, x)
    return x


def pieces(
    robot: Robot, target: Array, tolerance: tuple[float, float], q: Array, moves: Flags, reference: Array, known: Array,
    few: bool,
) -> Array:  # fmt: skip
    """One configuration (k, n) of each piece inside the limits of the curve of roots through q (n,).

    Points half a turn outside come inside by sliding: no piece is missed, unless only a few near the reference are
    asked for. Nothing where the curve is already known: the first piece's is one of the configurations (m, n) that are.
    """
    each = 2 if few else MOST_WINDINGS
    tolerance = min(tolerance[0], CLOSE), min(tolerance[1], CLOSE)
    starts = windings(robot, q, reference, moves, slack=pi + BAND, each=each)[: FEW if few else None]
    still = windings(robot, q, reference, ~moves, each=each)
    found = np.empty((0, robot.n))
    for first, start in enumerate(starts if len(still) else ()):
        point = slide(robot, target, np.where(moves, start, still[0]), reference)[None]
        point = inside(robot, target, tolerance, point)
        if first == 0 and len(point) and is_among(point[0], known):
            break
        if len(point) and not is_among(point[0], found):
            found = np.vstack([found, point])
    rows = [np.where(moves, point, others) for point in found for others in still]
    return inside(robot, target, tolerance, np.array(rows).reshape(-1, robot.n))


def is_among(q: Array, rows: Array) -> bool:
    """Whether q (n,) is one of the rows (k, n), turns counted."""
    return bool(len(rows) and np.abs(rows - q).max(axis=1).min() < 10.0 * SAME)


@compiled
def first_of_each(rows: Array, first: Flags) -> None:
    """Say which rows (k, n) have no earlier one so near, turns counted, that it is the same."""
    for k in range(rows.shape[0]):
        first[k] = True
        for j in range(k):
            far = 0.0
            for i in range(rows.shape[1]):
                far = max(far, abs(rows[k, i] - rows[j, i]))
            if first[j] and far < 10.0 * SAME:
                first[k] = False
                break


def unique(rows: Array) -> Array:
    """Of rows (k, n) each configuration once."""
    first = np.empty(len(rows), np.bool_)
    first_of_each(rows, first)
    return rows[first]
