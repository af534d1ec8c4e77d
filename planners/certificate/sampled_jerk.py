"""Sampled jerk: differences of accelerations at the rate of a controller."""

from __future__ import annotations

import numpy as np

from optik.check import check_number
from optik.errors import InvalidInput
from optik.types import Array
from planners.trajectory import Trajectory

RATES = (1e-6, 1e9)
"""Range of a controller's rate [1/s], in which differences describe the motion."""
PERIODS = 1_000_000
"""Largest number of periods that are all evaluated: half a minute of computing."""


def sampled_jerk(trajectory: Trajectory, rate: float) -> Array:
    """Return the largest difference of accelerations over one period of a controller, divided by the period."""
    if not RATES[0] <= check_number(rate, "rate", "samples per second") <= RATES[1]:
        raise InvalidInput("rate", f"{rate:.9g}", f"samples per second, in [{RATES[0]:g}, {RATES[1]:g}]")
    periods = max(int(trajectory.end * rate + 1e-9), 1)
    first = np.arange(min(periods, PERIODS))
    if (
        periods > PERIODS
    ):  # a motion of days: periods around the knots, where accelerations change fastest, and a sample
        around = np.floor(trajectory.knots[:, None] * rate) + np.arange(-1, 2)
        first = np.concatenate([np.linspace(0, periods - 1, PERIODS), np.clip(around.ravel(), 0, periods - 1)])
    begin, end = (np.minimum(np.floor(i) / rate, trajectory.end) for i in (first, first + 1))
    difference: Array = np.abs(trajectory(end, 2) - trajectory(begin, 2)).max(axis=0) * rate
    return difference
