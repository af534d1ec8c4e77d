"""Restart logic of one lane: initial guess, seeds, joint wrapping, limits, termination.

An attempt ignores the limits, since the iteration may leave and re-enter them. When it meets the target, 2π-multiples bring
the joints inside, to the winding nearest to the initial guess; if that is impossible, the configuration is clamped to the
limits and the attempt continues with clamped steps. An attempt without progress ends, and the next one begins: the first
from the caller's initial guess, the others as in `optik.ik._lm.guesses`. There is no randomness at run time: the same
problem has the same result in any lane, thread and process.

All functions take the array of `optik.ik._lm.packing.pack` and the work array of `optik.ik._lm.lanes`.
"""

from __future__ import annotations

import numpy as np

from optik.arm.reach import outside_reach
from optik.compiled import inlined
from optik.ik._lm.guesses import BOUNDED, FREE, begin_attempt, put
from optik.ik._lm.lanes import (
    ATTEMPT,
    BEGINS,
    BEST,
    BEST_E,
    CLAMPED,
    ENDING,
    FLAG,
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
    PUSHED,
    SAME,
    STALL,
    TOTAL,
    E,
    Q,
    S,
    correct_half_turn,
)  # fmt: skip
from optik.ik._lm.packing import (
    AT_ATTEMPTS,
    AT_FEW,
    AT_ITERATIONS,
    AT_LOWER,
    AT_PATIENCE,
    AT_PROGRESS,
    AT_REACH,
    AT_SLIDES,
    AT_TOLERANCE_P,
    AT_TOLERANCE_R,
    AT_UPPER,
)  # fmt: skip
from optik.ik._lm.winding import inside_winding
from optik.ik.problem import MAX_ITERATIONS, OUTSIDE_LIMITS, SAME_ENDS, SAME_RESIDUAL, SOLVED, STALLED, UNREACHABLE
from optik.types import Array

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
