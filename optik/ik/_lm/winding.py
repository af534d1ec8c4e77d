"""Whole turns: which of the angles that look alike is meant."""

from __future__ import annotations

from math import pi

import numpy as np

from optik.compiled import inlined

TURN = 2.0 * pi
ROUNDING = 1e-9


@inlined
def inside_winding(q: float, start: float, low: float, high: float) -> float:
    """Angle of the same direction as q inside [low, high], the nearest to the start; outside only if there is none.

    An angle inside that is within half a turn of the start stays as it is, to the last bit. Of those outside, the one
    nearest to the limits.
    """
    inside = low <= q <= high
    if inside and abs(start - q) <= pi + 1e-6:
        return q
    turned = q + np.floor((start - q) / TURN + 0.5) * TURN
    # an angle that rounding puts past a limit is meant to be on it: the caller cuts it
    if low - ROUNDING <= turned <= high + ROUNDING:
        return float(turned)
    up_to = np.floor((high + ROUNDING - q) / TURN)
    down_to = np.ceil((low - ROUNDING - q) / TURN)
    if inside:  # the nearest to the start is outside, so the nearest inside is the last one on that side
        turns = up_to if turned > high else down_to
        return float(q + turns * TURN) if turns != 0.0 else q
    below = up_to if turned > high else down_to - 1.0
    past_low, past_high = low - (q + below * TURN), q + (below + 1.0) * TURN - high
    return float(q + below * TURN if past_low <= past_high else q + (below + 1.0) * TURN)
