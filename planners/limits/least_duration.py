"""Least duration of a move of the joints from rest to rest, each joint alone: no motion along any path is faster."""

from __future__ import annotations

import numpy as np

from optik.types import Array
from planners.limits.base import sides
from planners.limits.motion_limits import MotionLimits

HALVINGS = 100
"""Halvings of the interval of a joint's peak speed: from 1e9 to the last bit of 1e-12."""


def compute_least_duration(away: Array, limits: MotionLimits) -> float:
    """Return the least duration [s] of a move by `away` (n,) [rad, m]: that of the slowest joint, by its limits alone.

    A joint reaches its peak speed v from rest in v / A + A / J, or in 2 (v / J)^½ if it does not reach A; the distance is
    half of v times this. The peak speed is the limit V, or less if the distance is short.
    """
    bounds, d = limits.bounds(away.size), np.abs(away)
    V, J, (lower, upper) = bounds["velocity"], bounds["jerk"], sides(bounds["acceleration"])
    ramps = np.where(away > 0.0, upper, -lower), np.where(away > 0.0, -lower, upper)

    def ramp_time(v: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):  # limits may be infinite
            return np.asarray(sum(np.where(v * J > A * A, v / A + A / J, 2.0 * np.sqrt(v / J)) for A in ramps))

    low, high = np.zeros(d.size), np.minimum(V, 1e9)
    for _ in range(HALVINGS):
        v = 0.5 * (low + high)
        short = 0.5 * v * ramp_time(v) < d
        low, high = np.where(short, v, low), np.where(short, high, v)
    return float((0.5 * ramp_time(high) + d / high).max(initial=0.0, where=d > 0.0))
