"""Attempts of one lane: initial guesses, seeds, windings, limits, partial poses, termination.

An attempt ignores the limits, since the iteration may leave and re-enter them. When it meets the target, 2π-multiples bring
the joints inside, to the winding nearest to the initial guess; if that is impossible, the configuration is clamped to the
limits and the attempt continues with clamped steps. An attempt without progress ends, and the next one begins: the first
from the caller's initial guess, the others as in `optik.ik._lm.search`. There is no randomness at run time: the same
problem has the same result in any lane, thread and process.

All functions take the array of `optik.ik._lm.lanes.pack_arm` and the work array of `optik.ik._lm.lanes`.
"""

from __future__ import annotations

from math import pi

import numpy as np

from optik.arm.reach import outside_reach
from optik.compiled import compiled, inlined
from optik.ik._gauss_newton import Rule, descend_inside
from optik.ik._lm.lanes import (
    AT_ATTEMPTS,
    AT_BEST,
    AT_BEST_E,
    AT_FEW,
    AT_FIRST,
    AT_ITERATIONS,
    AT_LOWER,
    AT_MOVES,
    AT_PATIENCE,
    AT_PROGRESS,
    AT_REACH,
    AT_SEEDS,
    AT_SLIDES,
    AT_SPARE,
    AT_TOLERANCE_P,
    AT_TOLERANCE_R,
    AT_UPPER,
    ATTEMPT,
    BEGINS,
    BEST,
    BEST_E,
    CLAMPED,
    COMPARED_SEEDS,
    ENDING,
    FLAG,
    GOAL,
    HELD_JOINTS,
    HIGH,
    ITERATION,
    LEAST_E,
    LEAST_END,
    LOW,
    MOVED,
    NEARLY_HALF_TURN,
    NEXT,
    OUTSIDE,
    PICKED,
    PICKS,
    PUSHED,
    SAME,
    SEEDS,
    STALL,
    TOTAL,
    E,
    Q,
    S,
    correct_half_turn,
    stack,
)
from optik.ik.problem import MAX_ITERATIONS, OUTSIDE_LIMITS, SAME_ENDS, SAME_RESIDUAL, SOLVED, STALLED, UNREACHABLE
from optik.kinematics import Chain, Range
from optik.task import Goal
from optik.types import Array, Flags

# ---------------- windings of revolute joints


WHOLE_TURN = 2.0 * pi
"""One turn of a revolute joint [rad]."""
TURN_SLACK = 1e-9
"""An angle outside a limit by at most this [rad] counts as on it: adding turns rounds, and the caller clamps."""
TIE = 1e-6
"""An angle stays unchanged up to this [rad] beyond half a turn from the initial guess, so that rounding does not decide."""


@inlined
def inside_winding(q: float, start: float, low: float, high: float) -> float:
    """Return the angle q + 2πk inside the limits that is nearest to the initial guess.

    An angle inside the limits and within half a turn of the initial guess is returned unchanged, bit for bit. If no angle
    q + 2πk is inside, the one nearest to the limits is returned.

    Shapes and units: q [rad], start [rad], low, high [rad]. Returns [rad].
    """
    inside = low <= q <= high
    if inside and abs(start - q) <= pi + TIE:
        return q
    turned = q + np.floor((start - q) / WHOLE_TURN + 0.5) * WHOLE_TURN
    if low - TURN_SLACK <= turned <= high + TURN_SLACK:
        return float(turned)
    up_to = np.floor((high + TURN_SLACK - q) / WHOLE_TURN)
    down_to = np.ceil((low - TURN_SLACK - q) / WHOLE_TURN)
    if inside:  # the nearest to the start is outside, so the nearest inside is the last one on that side
        turns = up_to if turned > high else down_to
        return float(q + turns * WHOLE_TURN) if turns != 0.0 else q
    below = up_to if turned > high else down_to - 1.0
    past_low, past_high = low - (q + below * WHOLE_TURN), q + (below + 1.0) * WHOLE_TURN - high
    return float(q + below * WHOLE_TURN if past_low <= past_high else q + (below + 1.0) * WHOLE_TURN)


# ---------------- one attempt of `lm` for a task that constrains a part of the pose


@compiled
def wrap_configuration(prismatic: Flags, limits: Range, start: Array, q: Array) -> bool:
    """Bring q inside the limits by 2π-multiples nearest to the initial guess, else clamp it; return whether q is unchanged.

    Shapes and units: prismatic (n,), start (n,) [rad, m], q (n,) [rad, m] (overwritten).
    """
    lower, upper = limits
    same = True
    for i in range(q.shape[0]):
        x = q[i] if prismatic[i] else inside_winding(q[i], start[i], lower[i], upper[i])
        x = min(max(x, lower[i]), upper[i])
        same = same and x == q[i]
        q[i] = x
    return same


@compiled
def attempt_task(
    chain: Chain, limits: Range, goal: Goal, rule: Rule, clamped: bool, q: Array, trace: Array
) -> tuple[int, int]:  # fmt: skip
    """Iterate from q (n,) inside the limits; or ignore the limits until the task is met outside them, then iterate inside.

    Returns the number of steps, and SOLVED, MAX_ITERATIONS, STALLED or OUTSIDE_LIMITS; `trace` is that of `descend_inside`.
    """
    (lower, upper), start, iteration = limits, q.copy(), 0
    if not clamped:
        low, high = lower.copy(), upper.copy()
        for i in range(q.shape[0]):
            if lower[i] < upper[i]:
                low[i], high[i] = -np.inf, np.inf
        iteration, code, _, _ = descend_inside(chain, (low, high), goal, rule, 0, q, trace)
        if wrap_configuration(chain[1], limits, start, q) or code != SOLVED:
            return iteration, code
    iteration, code, _, _ = descend_inside(chain, limits, goal, rule, iteration, q, trace)
    return iteration, OUTSIDE_LIMITS if code == STALLED and not clamped else code


# ---------------- initial guesses of attempts, and the joints that they hold


NEAREST_SEEDS = 16
"""Number of seeds that are tried in the order of the distance of their poses; the others follow in a fixed order."""
FREE = 9
"""Number of attempts before the first with bounded steps; with fewer, targets far from limits take longer (4: 3 %, 2: 15 %)."""
NEAR_BEST = 100
"""Number of attempts before the first that starts between the best iterate and a seed. On the panda, 10 % of these attempts
solve a singular target with joints at a limit, against 1 % of those from a seed. On regular targets they are worse."""
BOUNDED = -1.0
"""Value of ENDING for a lane that respects the limits and holds the joints that are pushed out of them."""
FROM_START = 7
"""Number of attempts from the caller's guess that hold joints: each skips one more of the joints nearest to their limits."""
INSIDE, ON_LIMITS = 0, 1
"""Kinds of seeds: anywhere inside the limits, or with as many joints at a limit as the arm has redundant ones."""


@inlined
def put(arm: Array, w: Array, l: int, i: int, q: float) -> None:
    """Set a joint's value, clamped to its limits, in the configuration to which a lane moves next.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), q [rad, m].
    """
    w[NEXT + i, l] = min(max(q, arm[AT_LOWER + i]), arm[AT_UPPER + i])
    w[MOVED, l] = 1.0


@inlined
def begin_attempt(arm: Array, w: Array, n: int, start: Array, l: int) -> None:
    """Set the initial guess of a lane's attempt: the caller's, then the nearest seeds, then the other seeds.

    Attempt FREE starts from the caller's guess again. For redundant arms, FROM_START attempts from there hold some of the
    joints, and then every second attempt from a seed. From attempt NEAR_BEST on, two out of three of the other attempts
    start between the best iterate so far and a seed.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say], start (n,) [rad, m].
    """
    attempt, spare = int(w[ATTEMPT, l]), arm[AT_SPARE] != 0.0
    if attempt > 0 and attempt == int(arm[AT_FIRST]):
        w[BEST_E, l] = arm[AT_BEST_E]
        for i in range(n):
            w[BEST + i, l] = arm[AT_BEST + i]
    w[ITERATION, l], w[LEAST_E, l], w[STALL, l], w[CLAMPED, l] = 0.0, np.inf, 0.0, 0.0
    w[BEGINS, l], w[HELD_JOINTS, l], w[ENDING, l] = 0.0, 0.0, 0.0
    late, again = attempt - FREE, FROM_START if spare else 1
    if attempt == 0 or 0 <= late < again:
        for i in range(n):
            put(arm, w, l, i, start[i])
        if attempt == 0:
            for i in range(n):
                w[BEST + i, l] = w[NEXT + i, l]
        elif spare:
            hold_nearest(arm, w, n, start, late, l)
        return
    kind, k, way = INSIDE, attempt - 1, 1.0
    if late >= 0:
        turn = late - again
        k = turn // 2 if spare else turn
        if spare and turn % 2 == 0:
            kind = ON_LIMITS
        else:
            if attempt >= NEAR_BEST and w[BEST_E, l] < np.inf:
                way = 0.5 ** (k % 3)
            k += FREE - 1
    start_from_seed(arm, w, n, kind, k, way, l)


@inlined
def hold_nearest(arm: Array, w: Array, n: int, start: Array, skip: int, l: int) -> None:
    """Hold as many joints as are redundant at the limits nearest to the initial guess, relative to their ranges.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), start (n,) [rad, m].
    """
    seen = 0
    for k in range(skip + int(arm[AT_SPARE])):
        nearest, least = -1, np.inf
        for i in range(n):
            width = arm[AT_UPPER + i] - arm[AT_LOWER + i]
            distance = min(start[i] - arm[AT_LOWER + i], arm[AT_UPPER + i] - start[i])
            distance /= width if width < np.inf else WHOLE_TURN
            if distance < least and arm[AT_MOVES + i] != 0.0 and not seen >> i & 1:
                nearest, least = i, distance
        if nearest >= 0:
            seen |= 1 << nearest
            if k >= skip:
                at_lower = start[nearest] - arm[AT_LOWER + nearest] <= arm[AT_UPPER + nearest] - start[nearest]
                put(arm, w, l, nearest, arm[AT_LOWER + nearest] if at_lower else arm[AT_UPPER + nearest])
                w[HELD_JOINTS, l] += float(1 << nearest)


@inlined
def start_from_seed(arm: Array, w: Array, n: int, kind: int, k: int, way: float, l: int) -> None:
    """Start from a seed, and hold the joints that it has at a limit.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), way [1].
    """
    table = AT_SEEDS + kind * (13 * COMPARED_SEEDS + SEEDS * n)
    if k < NEAREST_SEEDS and w[PICKED + kind, l] == 0.0:
        pick_seeds(arm, w, table, PICKS + kind * NEAREST_SEEDS, l)
        w[PICKED + kind, l] = 1.0
    row = int(w[PICKS + kind * NEAREST_SEEDS + k, l]) if k < NEAREST_SEEDS else ((k + 1) * 7919) % SEEDS
    for i in range(n):
        q = arm[table + 13 * COMPARED_SEEDS + row * n + i]
        put(arm, w, l, i, q if way == 1.0 else w[BEST + i, l] + way * (q - w[BEST + i, l]))
        if kind == ON_LIMITS and arm[AT_MOVES + i] != 0.0 and (q == arm[AT_LOWER + i] or q == arm[AT_UPPER + i]):
            w[HELD_JOINTS, l] += float(1 << i)


@inlined
def pick_seeds(arm: Array, w: Array, table: int, picks: int, l: int) -> None:
    """Find the NEAREST_SEEDS of a table whose poses are nearest to the goal, nearest first.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten).
    """
    score, kept = stack(1, COMPARED_SEEDS), stack(1, NEAREST_SEEDS)
    count = 0
    for m in range(COMPARED_SEEDS):
        score[0, m] = arm[table + 12 * COMPARED_SEEDS + m]
    for i in range(12):
        g = w[GOAL + i, l]
        for m in range(COMPARED_SEEDS):
            score[0, m] -= g * arm[table + i * COMPARED_SEEDS + m]
    for m in range(COMPARED_SEEDS):
        s = score[0, m]
        if count < NEAREST_SEEDS or s < kept[0, NEAREST_SEEDS - 1]:
            j = min(count, NEAREST_SEEDS - 1)
            while j > 0 and kept[0, j - 1] > s:
                kept[0, j] = kept[0, j - 1]
                w[picks + j, l] = w[picks + j - 1, l]
                j -= 1
            kept[0, j] = s
            w[picks + j, l] = m
            count += 1


# ---------------- restart logic of one lane


BOUNDED_PATIENCE = 2.0
"""Patience of attempts that hold joints at limits. It suffices for 95 % of the successful attempts and halves the iterations
of the others."""
STEP, MEASURE = -1, -2
"""Codes besides those of `IKStatus`: the lane takes a step, or it has moved and its error must be measured first."""


@inlined
def wrap_inside(arm: Array, w: Array, n: int, start: Array, l: int) -> bool:
    """Bring a lane inside the limits by 2π-multiples nearest to the initial guess, else clamp it; return whether it stayed.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), start (n,) [rad, m].
    """
    same = True
    for i in range(n):
        low, high, q = arm[AT_LOWER + i], arm[AT_UPPER + i], w[Q + i, l]
        x = q if arm[AT_SLIDES + i] != 0.0 else inside_winding(q, start[i], low, high)
        x = min(max(x, low), high)
        same = same and x == q
        w[Q + i, l] = x
    return same


@inlined
def is_inside(arm: Array, w: Array, n: int, l: int) -> bool:
    """Return whether a lane is inside the limits: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say]."""
    for i in range(n):  # noqa: SIM110  (a generator does not compile)
        if not (arm[AT_LOWER + i] <= w[Q + i, l] <= arm[AT_UPPER + i]):
            return False
    return True


@inlined
def place_lane(arm: Array, w: Array, n: int, start: Array, l: int) -> None:
    """Move a lane to its next configuration, or to the initial guess of its attempt, and set the bounds of its steps.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), start (n,) [rad, m].
    """
    if w[BEGINS, l] != 0.0:
        begin_attempt(arm, w, n, start, l)
    clamped = w[CLAMPED, l] != 0.0
    w[MOVED, l] = 0.0
    for i in range(n):
        w[Q + i, l] = w[NEXT + i, l]
        w[LOW + i, l] = arm[AT_LOWER + i] if clamped else -1e9
        w[HIGH + i, l] = arm[AT_UPPER + i] if clamped else 1e9


@inlined
def flag_lanes(arm: Array, w: Array) -> None:
    """Count the progress of every lane, and flag lanes that converged, stalled or reached the iteration limit.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten).
    """
    tolerance_p, tolerance_r = arm[AT_TOLERANCE_P] * arm[AT_TOLERANCE_P], arm[AT_TOLERANCE_R] * arm[AT_TOLERANCE_R]
    progress, patience, most = arm[AT_PROGRESS], arm[AT_PATIENCE], arm[AT_ITERATIONS]
    for l in range(w.shape[1]):
        cost = w[E, l]
        least = w[LEAST_E, l]
        better = cost < progress * least
        stall = 0.0 if better else w[STALL, l] + 1.0
        w[LEAST_E, l], w[STALL, l] = cost if better else least, stall
        met = (w[S, l] <= tolerance_p) & (w[S + 1, l] <= tolerance_r)
        # NaN is no progress either
        over = (w[ITERATION, l] >= most) | (stall >= patience) | (not cost < np.inf)
        look = met | over | (w[ENDING, l] != 0.0) | (w[S + 1, l] >= NEARLY_HALF_TURN)
        w[FLAG, l] = 1.0 if look else 0.0
        step = 0.0 if look else 1.0
        # the initial guess is inside the limits and already stored as the best: only its error is new
        at_start = (w[ITERATION, l] == 0.0) & (w[ATTEMPT, l] == 0.0) & (w[CLAMPED, l] == 0.0) & (cost < np.inf)
        w[BEST_E, l] = cost if at_start else w[BEST_E, l]
        w[ITERATION, l] += step
        w[TOTAL, l] += step


@inlined
def judge_lane(arm: Array, w: Array, n: int, start: Array, l: int) -> int:
    """Return the final status of a flagged lane, or STEP or MEASURE if it continues.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say], start (n,) [rad, m].
    """
    tolerance_p, tolerance_r = arm[AT_TOLERANCE_P], arm[AT_TOLERANCE_R]
    if w[S, l] <= tolerance_p * tolerance_p and w[S + 1, l] <= tolerance_r * tolerance_r:
        # after clamping, steps respect the limits: wrapping again could repeat for ever if rounding absorbs a turn
        if w[CLAMPED, l] != 0.0 or wrap_inside(arm, w, n, start, l):
            return SOLVED
        w[OUTSIDE, l], w[CLAMPED, l], w[LEAST_E, l], w[STALL, l] = 1.0, 1.0, np.inf, 0.0
        if w[ATTEMPT, l] >= FREE:
            w[ENDING, l], w[HELD_JOINTS, l] = BOUNDED, PUSHED
        for i in range(n):
            put(arm, w, l, i, w[Q + i, l])
        return MEASURE
    if w[ITERATION, l] >= arm[AT_ITERATIONS]:
        return MAX_ITERATIONS
    patience = min(arm[AT_PATIENCE], BOUNDED_PATIENCE) if w[ENDING, l] == BOUNDED else arm[AT_PATIENCE]
    return STALLED if w[STALL, l] >= patience or not w[E, l] < np.inf else STEP


@inlined
def is_useless(arm: Array, w: Array, l: int) -> bool:
    """Count the end of a lane's attempt, and return whether more attempts are of no use: `optik.ik.problem.Ends`.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten).
    """
    if w[OUTSIDE, l] != 0.0:
        return False
    least, cost = w[LEAST_END, l], w[E, l]
    if cost < (1.0 - SAME_RESIDUAL) ** 2 * least:
        w[LEAST_END, l], w[SAME, l] = cost, 1.0
    elif cost <= (1.0 + SAME_RESIDUAL) ** 2 * least:
        w[SAME, l] += 1.0
    enough: bool = w[SAME, l] >= SAME_ENDS and (arm[AT_FEW] != 0.0 or w[SAME, l] == w[ATTEMPT, l] + 1.0)
    return enough


@inlined
def next_attempt(arm: Array, w: Array, n: int, start: Array, l: int, attempts: float) -> bool:
    """Begin the next attempt, or return True and move the lane to the best configuration if there is none.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), start (n,) [rad, m].
    """
    if w[E, l] < w[BEST_E, l] and is_inside(arm, w, n, l):
        w[BEST_E, l] = w[E, l]
        for i in range(n):
            w[BEST + i, l] = w[Q + i, l]
    if w[ATTEMPT, l] + 1.0 < attempts and not is_useless(arm, w, l):
        w[ATTEMPT, l] += 1.0
        w[BEGINS, l], w[MOVED, l] = 1.0, 1.0
        return False
    for i in range(n):
        q = w[BEST + i, l] if w[BEST_E, l] < np.inf else w[Q + i, l]
        put(arm, w, l, i, q if abs(q) < 1e9 else start[i])
    return True


@inlined
def advance(arm: Array, w: Array, n: int, target: Array, start: Array, l: int) -> int:
    """Return the status of a flagged lane after preparing its next step, attempt or end.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), target (4, 4) [1, m],
    start (n,) [rad, m].
    """
    correct_half_turn(w, l)
    if w[ENDING, l] > 0.0:
        return int(w[ENDING, l])
    status = judge_lane(arm, w, n, start, l)
    if status == STEP:
        w[ITERATION, l] += 1.0
        w[TOTAL, l] += 1.0
    elif status in (MAX_ITERATIONS, STALLED):
        proved = outside_reach(arm[AT_REACH : AT_REACH + 8], target, arm[AT_TOLERANCE_P], arm[AT_TOLERANCE_R]) >= 0.0
        if next_attempt(arm, w, n, start, l, 0.0 if proved else arm[AT_ATTEMPTS]):
            w[ENDING, l] = UNREACHABLE if proved else (OUTSIDE_LIMITS if w[OUTSIDE, l] != 0.0 else status)
        return MEASURE
    return status
