"""Initial guesses of attempts, and the joints that they hold: first the caller's guess, then seeds near the target.

A redundant arm reaches a target with a continuum of solutions. If most of them are outside the limits, attempts rarely find
those inside. But at the boundary of the set inside, as many joints are at a limit as the arm has redundant ones. With these
joints held, the other six have isolated solutions, which attempts from nearby find. So some attempts hold joints at limits.
"""

from __future__ import annotations

import numpy as np

from optik.compiled import inlined
from optik.ik._lm.lanes import (
    ATTEMPT,
    BEGINS,
    BEST,
    BEST_E,
    CLAMPED,
    ENDING,
    GOAL,
    HELD_JOINTS,
    ITERATION,
    LEAST_E,
    MOVED,
    NEXT,
    PICKED,
    PICKS,
    STALL,
)
from optik.ik._lm.packing import (
    AT_BEST,
    AT_BEST_E,
    AT_FIRST,
    AT_LOWER,
    AT_MOVES,
    AT_SEEDS,
    AT_SPARE,
    AT_UPPER,
    COMPARED_SEEDS,
    SEEDS,
)  # fmt: skip
from optik.ik._lm.stack import stack
from optik.ik._lm.winding import WHOLE_TURN
from optik.types import Array

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
