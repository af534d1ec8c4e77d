"""Where attempts start, and which joints they hold: the caller's configuration first, then known ones near the target.

An arm with joints to spare meets a target in a continuum of configurations. Where many joints of the wanted one are at
their limits, next to nothing of that continuum is inside, and an attempt that is free to move along it does not find
what is. But there are as many joints at a limit as are to spare (move along the continuum until they are); held there,
they leave six joints, whose solutions stand alone and are found from nearby. So some attempts hold joints at limits.
"""

from __future__ import annotations

import numpy as np

from optik.compiled import inlined
from optik.ik._lm.lanes import (
    ATTEMPT,
    BEGINS,
    BEST,
    CLAMPED,
    GOAL,
    HOLDS,
    ITERATION,
    LEAST,
    MOVED,
    NEXT,
    PICKED,
    PICKS,
    STALL,
)
from optik.ik._lm.packed import LOWER, MOVES, NEAR, SEED_POSES, SEEDS, SPARE, UPPER
from optik.ik._lm.stack import stack
from optik.types import Array

NEAREST = 16
"""Seeds that are tried in the order of their poses' distance; the others follow in a fixed order."""

FREE = 9
"""Attempts before the first that holds joints: with fewer, targets far from limits take longer (4: 3 %, 2: 15 %)."""

AROUND = 7
"""Attempts from the caller's start that hold joints: from those nearest to their limits to the six farthest left out."""

INSIDE, ON_LIMITS = 0, 1
"""Kinds of seeds: anywhere inside the limits, or with as many joints at a limit as are to spare."""


@inlined
def put(arm: Array, w: Array, l: int, i: int, q: float) -> None:
    """Have joint i put elsewhere, inside its limits, once the other lanes have taken their step."""
    w[NEXT + i, l] = min(max(q, arm[LOWER + i]), arm[UPPER + i])
    w[MOVED, l] = 1.0


@inlined
def begin(arm: Array, w: Array, n: int, start: Array, l: int) -> None:
    """Go where the lane's attempt starts: the caller's configuration, the nearest seeds, then the others in turn.

    Where joints are to spare, later attempts hold them: some from the caller's start, then every second seed's.
    """
    attempt = int(w[ATTEMPT, l])
    w[ITERATION, l], w[LEAST, l], w[STALL, l], w[CLAMPED, l] = 0.0, np.inf, 0.0, 0.0
    w[BEGINS, l], w[HOLDS, l] = 0.0, 0.0
    late = attempt - FREE if arm[SPARE] != 0.0 else -1
    if attempt == 0 or 0 <= late < AROUND:
        for i in range(n):
            put(arm, w, l, i, start[i])
        if attempt == 0:
            for i in range(n):
                w[BEST + i, l] = w[NEXT + i, l]
        else:
            hold_nearest(arm, w, n, start, late, l)
    else:
        turn = late - AROUND
        kind = ON_LIMITS if late >= 0 and turn % 2 == 0 else INSIDE
        k = attempt - 1 if late < 0 else turn // 2
        from_seed(arm, w, n, kind, k + (FREE - 1 if late >= 0 and kind == INSIDE else 0), l)


@inlined
def hold_nearest(arm: Array, w: Array, n: int, start: Array, skip: int, l: int) -> None:
    """Hold as many joints as are to spare at the limits they start nearest to, the `skip` nearest of all left out."""
    seen = 0
    for k in range(skip + int(arm[SPARE])):
        nearest, least = -1, np.inf
        for i in range(n):
            distance = min(start[i] - arm[LOWER + i], arm[UPPER + i] - start[i])
            if distance < least and arm[MOVES + i] != 0.0 and not seen >> i & 1:
                nearest, least = i, distance
        if nearest >= 0:
            seen |= 1 << nearest
            if k >= skip:
                at_lower = start[nearest] - arm[LOWER + nearest] <= least
                put(arm, w, l, nearest, arm[LOWER + nearest] if at_lower else arm[UPPER + nearest])
                w[HOLDS, l] += float(1 << nearest)


@inlined
def from_seed(arm: Array, w: Array, n: int, kind: int, k: int, l: int) -> None:
    """Start at the k-th seed of a kind, the nearest first, holding what it has at a limit."""
    table = SEED_POSES + kind * (13 * NEAR + SEEDS * n)
    if k < NEAREST and w[PICKED + kind, l] == 0.0:
        pick_seeds(arm, w, table, PICKS + kind * NEAREST, l)
        w[PICKED + kind, l] = 1.0
    row = int(w[PICKS + kind * NEAREST + k, l]) if k < NEAREST else ((k + 1) * 7919) % SEEDS
    for i in range(n):
        q = arm[table + 13 * NEAR + row * n + i]
        put(arm, w, l, i, q)
        if kind == ON_LIMITS and arm[MOVES + i] != 0.0 and (q == arm[LOWER + i] or q == arm[UPPER + i]):
            w[HOLDS, l] += float(1 << i)


@inlined
def pick_seeds(arm: Array, w: Array, table: int, picks: int, l: int) -> None:
    """Note the NEAREST seeds of a table whose poses are nearest to the goal, nearest first."""
    score, kept = stack(1, NEAR), stack(1, NEAREST)
    count = 0
    for m in range(NEAR):
        score[0, m] = arm[table + 12 * NEAR + m]
    for i in range(12):
        g = w[GOAL + i, l]
        for m in range(NEAR):
            score[0, m] -= g * arm[table + i * NEAR + m]
    for m in range(NEAR):
        s = score[0, m]
        if count < NEAREST or s < kept[0, NEAREST - 1]:
            j = min(count, NEAREST - 1)
            while j > 0 and kept[0, j - 1] > s:
                kept[0, j] = kept[0, j - 1]
                w[picks + j, l] = w[picks + j - 1, l]
                j -= 1
            kept[0, j] = s
            w[picks + j, l] = m
            count += 1
