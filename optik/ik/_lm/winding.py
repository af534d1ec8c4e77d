"""Whole turns of revolute joints: the 2π-multiple inside the limits that is nearest to the start."""

from __future__ import annotations

from math import pi

import numpy as np

from optik.compiled import inlined

WHOLE_TURN = 2.0 * pi
"""One turn of a revolute joint [rad]."""

TURN_SLACK = 1e-9
"""How far outside a limit an angle counts as on it [rad]: adding turns rounds it, and the caller clamps it."""

TIE = 1e-6
"""How far beyond half a turn from the start an angle still stays as it is [rad]: of two alike, rounding would decide."""


@inlined
def inside_winding(q: float, start: float, low: float, high: float) -> float:
    """Angle of the same direction inside the limits that is nearest to the start.

    An angle inside that is within half a turn of the start is returned as it is, to the last bit. Where no angle of the
    direction is inside, the one nearest to the limits is returned.

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
