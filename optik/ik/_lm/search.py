"""Restart logic of one lane: initial guess, seeds, joint wrapping, limits, termination.

An attempt runs free of the limits, since the iteration may leave them and come back. Where it meets the target, whole
turns bring the joints inside (the winding nearest to the start); where they cannot, the configuration is clamped to the
limits and the attempt goes on with every step clamped. An attempt that makes no more progress ends, and the next begins:
the first at the caller's start, the others as `optik.ik._lm.starts` says. Nothing is drawn at run time: the same problem
has the same answer in any lane, thread and process.

All functions take the arm as `optik.ik._lm.packed.pack` wrote it, and the work array of `optik.ik._lm.lanes`.
"""

from __future__ import annotations

import numpy as np

from optik.arm.reach import outside_reach
from optik.compiled import inlined
from optik.ik._lm.lanes import (
    ATTEMPT,
    BEGINS,
    BEST,
    BEST_E,
    CLAMPED,
    ENDING,
    HELD_JOINTS,
    HIGH,
    ITERATION,
    LEAST_E,
    LOOK,
    LOW,
    MOVED,
    NEARLY_HALF_TURN,
    NEXT,
    OUTSIDE,
    PUSHED,
    STALL,
    TOTAL,
    E,
    Q,
    S,
    face_about,
)  # fmt: skip
from optik.ik._lm.packed import (
    AT_ATTEMPTS,
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
from optik.ik._lm.starts import BOUNDED, FREE, begin, put
from optik.ik._lm.winding import inside_winding
from optik.ik._status import MAX_ITERATIONS, OUTSIDE_LIMITS, SOLVED, STALLED, UNREACHABLE
from optik.types import Array

BOUNDED_PATIENCE = 2.0
"""Patience of attempts that hold joints at limits. It is enough for 95 % of the successful attempts, and halves the iterations
of the others."""

STEP, HELD = -1, -2
"""Codes besides those of `IKStatus`: the lane takes a step; it was put elsewhere and must be measured first."""


@inlined
def wrap_inside(arm: Array, w: Array, n: int, start: Array, l: int) -> bool:
    """Bring a lane inside the limits: by whole turns, to the winding nearest to the start, else clamped.

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
def inside(arm: Array, w: Array, n: int, l: int) -> bool:
    """Whether a lane is inside the limits.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say].
    """
    for i in range(n):  # noqa: SIM110  (a generator does not compile)
        if not (arm[AT_LOWER + i] <= w[Q + i, l] <= arm[AT_UPPER + i]):
            return False
    return True


@inlined
def place(arm: Array, w: Array, n: int, start: Array, l: int) -> None:
    """Put a lane where it was sent or its attempt starts, with its steps clamped to the limits if it is to keep them.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), start (n,) [rad, m].
    """
    if w[BEGINS, l] != 0.0:
        begin(arm, w, n, start, l)
    clamped = w[CLAMPED, l] != 0.0
    w[MOVED, l] = 0.0
    for i in range(n):
        w[Q + i, l] = w[NEXT + i, l]
        w[LOW + i, l] = arm[AT_LOWER + i] if clamped else -1e9
        w[HIGH + i, l] = arm[AT_UPPER + i] if clamped else 1e9


@inlined
def tick(arm: Array, w: Array) -> None:
    """Count every lane's progress and flag those that converged, stalled or reached the iteration limit.

    The others are ready for a step.

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
        # NaN is no progress either, and never gets better
        over = (w[ITERATION, l] >= most) | (stall >= patience) | (not cost < np.inf)
        look = met | over | (w[ENDING, l] != 0.0) | (w[S + 1, l] >= NEARLY_HALF_TURN)
        w[LOOK, l] = 1.0 if look else 0.0
        step = 0.0 if look else 1.0
        # the start is inside the limits, and already kept as the best: only its error is new
        at_start = (w[ITERATION, l] == 0.0) & (w[ATTEMPT, l] == 0.0) & (w[CLAMPED, l] == 0.0) & (cost < np.inf)
        w[BEST_E, l] = cost if at_start else w[BEST_E, l]
        w[ITERATION, l] += step
        w[TOTAL, l] += step


@inlined
def look(arm: Array, w: Array, n: int, start: Array, l: int) -> int:
    """Judge a flagged lane.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say], start (n,) [rad, m].
    """
    tolerance_p, tolerance_r = arm[AT_TOLERANCE_P], arm[AT_TOLERANCE_R]
    if w[S, l] <= tolerance_p * tolerance_p and w[S + 1, l] <= tolerance_r * tolerance_r:
        # once brought inside, it keeps the limits: to turn it again could go on for ever where a turn is lost in rounding
        if w[CLAMPED, l] != 0.0 or wrap_inside(arm, w, n, start, l):
            return SOLVED
        w[OUTSIDE, l], w[CLAMPED, l], w[LEAST_E, l], w[STALL, l] = 1.0, 1.0, np.inf, 0.0
        if w[ATTEMPT, l] >= FREE:
            w[ENDING, l], w[HELD_JOINTS, l] = BOUNDED, PUSHED
        for i in range(n):
            put(arm, w, l, i, w[Q + i, l])
        return HELD
    if w[ITERATION, l] >= arm[AT_ITERATIONS]:
        return MAX_ITERATIONS
    patience = min(arm[AT_PATIENCE], BOUNDED_PATIENCE) if w[ENDING, l] == BOUNDED else arm[AT_PATIENCE]
    return STALLED if w[STALL, l] >= patience or not w[E, l] < np.inf else STEP


@inlined
def next_attempt(arm: Array, w: Array, n: int, start: Array, l: int, attempts: float) -> bool:
    """Begin the next attempt; where there is none, go back to the best configuration found, to be measured once more.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), start (n,) [rad, m].
    """
    if w[E, l] < w[BEST_E, l] and inside(arm, w, n, l):
        w[BEST_E, l] = w[E, l]
        for i in range(n):
            w[BEST + i, l] = w[Q + i, l]
    if w[ATTEMPT, l] + 1.0 < attempts:
        w[ATTEMPT, l] += 1.0
        w[BEGINS, l], w[MOVED, l] = 1.0, 1.0
        return False
    for i in range(n):
        q = w[BEST + i, l] if w[BEST_E, l] < np.inf else w[Q + i, l]
        put(arm, w, l, i, q if abs(q) < 1e9 else start[i])
    return True


@inlined
def advance(arm: Array, w: Array, n: int, target: Array, start: Array, l: int) -> int:
    """Decide how a flagged lane goes on.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), target (4, 4) [1, m],
    start (n,) [rad, m].
    """
    face_about(w, l)
    if w[ENDING, l] > 0.0:
        return int(w[ENDING, l])
    status = look(arm, w, n, start, l)
    if status == STEP:
        w[ITERATION, l] += 1.0
        w[TOTAL, l] += 1.0
    elif status in (MAX_ITERATIONS, STALLED):
        proved = outside_reach(arm[AT_REACH : AT_REACH + 8], target, arm[AT_TOLERANCE_P], arm[AT_TOLERANCE_R]) >= 0.0
        if next_attempt(arm, w, n, start, l, 0.0 if proved else arm[AT_ATTEMPTS]):
            w[ENDING, l] = UNREACHABLE if proved else (OUTSIDE_LIMITS if w[OUTSIDE, l] != 0.0 else status)
        return HELD
    return status
