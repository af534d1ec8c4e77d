"""The command servoj of Universal Robots, which follows set-points with a gain and a lookahead time."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.check import check_number, real_array
from optik.errors import InvalidInput
from optik.types import Array
from planners.trajectory import Trajectory

SERVO_PERIOD = 2e-3
"""Period of e-Series controllers [s]."""
AT_REST = 1e-12
"""Distance [rad] to the last set-point, and velocity [rad/s], at which the arm is at rest."""
LOOKAHEAD, GAIN = (0.03, 0.2), (100.0, 2000.0)
"""Ranges of the options, from the script manual [s, 1/s²]."""


class ServoJ:
    """A model of ``servoj(q, t=0.002, lookahead_time, gain)``: q̈ = gain (q_set − q − lookahead q̇) for one period.

    Source: the description of gain (a proportional term) and lookahead time (a projection of the position by the velocity) in
    https://www.universal-robots.com/articles/ur/programming/servoj-command. The manual has no formula and no unit of the gain:
    this is the simplest formula that fits its words, and a real arm may differ.

    Parameters
    ----------
    lookahead : float
        Lookahead time, 0.03 to 0.2 [s].
    gain : float
        Gain, 100 to 2000 [1/s²].

    Raises
    ------
    InvalidInput
        An option out of its range.
    """

    def __init__(self, lookahead: float = 0.1, gain: float = 300.0) -> None:
        for name, value, (least, most) in (("lookahead", lookahead, LOOKAHEAD), ("gain", gain, GAIN)):
            if check_number(value, name, f"a number in [{least:g}, {most:g}]", least=least) > most:
                raise InvalidInput(name, value, f"a number in [{least:g}, {most:g}]")
        self.lookahead, self.gain = lookahead, gain

    def follow(self, q: ArrayLike) -> Trajectory:
        """Return what the arm makes of set-points, for `planners.certify`.

        Parameters
        ----------
        q : (k, n) array
            Set-points at 500 Hz [rad], the first one at rest.

        Returns
        -------
        Trajectory
            The motion of the arm, with a constant acceleration in each period, until it is at rest at the last set-point.

        Raises
        ------
        InvalidInput
            Fewer than two set-points, or numbers that are not finite.
        """
        expected = "a (k, n) array of at least two finite set-points"
        given = real_array(q, "q", expected)
        if given.ndim != 2 or len(given) < 2 or not np.isfinite(given).all():
            raise InvalidInput("q", f"an array of shape {given.shape}", expected)
        pieces, place, speed, k = list[tuple[Array, Array, Array]](), given[0], np.zeros(given.shape[1]), 0
        while k < len(given) or np.abs(given[-1] - place).max() > AT_REST or np.abs(speed).max() > AT_REST:
            a = self.gain * (given[min(k, len(given) - 1)] - place - self.lookahead * speed)
            pieces.append((0.5 * a, speed, place))
            place, speed, k = place + SERVO_PERIOD * (speed + 0.5 * SERVO_PERIOD * a), speed + SERVO_PERIOD * a, k + 1
        t = SERVO_PERIOD * np.arange(k + 1)
        return Trajectory(scipy.interpolate.PPoly(np.stack(pieces, axis=1), t, extrapolate=True))
