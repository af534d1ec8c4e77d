"""A motion as a servo takes it: positions and velocities at every tick of its period, and how many periods it lasts."""

from __future__ import annotations

from typing import NamedTuple

from optik.types import Array

PERIOD = 0.004
"""The servo period by default [s]: 250 set-points per second, as many controllers of arms take them."""


class Setpoints(NamedTuple):
    """What the servo is sent at every tick: row k is the state of the motion at k periods, the last one its end.

    Attributes
    ----------
    period : float
        Of the servo [s].
    t : (k,) array
        Times of the ticks, 0 to the first whole number of periods that the motion does not exceed [s].
    q, dq, ddq : (k, n) arrays
        Positions [rad, m], velocities [rad/s, m/s] and accelerations [rad/s², m/s²].
    """

    period: float
    t: Array
    q: Array
    dq: Array
    ddq: Array
