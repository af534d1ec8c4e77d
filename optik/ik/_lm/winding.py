"""Windings of revolute joints: the 2π-multiple inside the limits that is nearest to the initial guess."""

from __future__ import annotations

from math import pi

import numpy as np

from optik.compiled import inlined

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
