"""Position limits, sampled jerk and the smallest singular value of a motion."""

from __future__ import annotations

import numpy as np

from optik import kinematics
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.check import check_number
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.kinematics import Chain
from optik.types import Array
from planners.certificate.violation import Violation
from planners.trajectory import Trajectory


def position_margins(robot: Robot, trajectory: Trajectory) -> Array:
    """Return the least distance of every joint to its position limits over a motion."""
    reach = trajectory.extrema(0)
    return np.minimum(reach.least - robot.limits.lower, robot.limits.upper - reach.greatest)


def position_times(robot: Robot, trajectory: Trajectory) -> Array:
    """Return the times at which the joints are nearest to their position limits (n,) [s]."""
    reach = trajectory.extrema(0)
    lower = reach.least - robot.limits.lower < robot.limits.upper - reach.greatest
    return np.where(lower, reach.t_least, reach.t_greatest)


def find_position_violations(
    margins: Array, joint_names: tuple[str, ...], times: Array | None = None
) -> list[Violation]:
    """Return the largest violation of a position limit above 1e-9, from the margins and their times."""
    i = int(np.argmin(margins))
    if margins[i] >= -LIMIT_TOLERANCE:
        return []
    t = 0.0 if times is None else float(times[i])
    words = f"{joint_names[i]} exceeds its range by {-margins[i]:.3g} (rad or m) at t = {t:.6g} s"
    return [Violation(words, t, "limits", joint_names[i])]


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


GRID_INSTANTS, FINER_INSTANTS = 121, 9
"""Number of instants of the first grid, which resolves minima of 1 % of the motion, and of each finer grid."""
GRID_WIDTH = 1e-4
"""Fraction of the duration below which a grid is not refined: at a smooth minimum the value is correct to 1e-8."""


def smallest_singular_value(robot: Robot, trajectory: Trajectory) -> tuple[float, float]:
    """Return the smallest singular value along a motion, and its time, from a grid that is refined around its minimum."""
    end = trajectory.end
    low, high, count = 0.0, end, GRID_INSTANTS
    while True:
        t, values = np.linspace(low, high, count), np.empty(count)
        _singular_values(robot.chain, trajectory.padded, trajectory.knots, t, values)
        k = int(values.argmin())
        if high - low <= GRID_WIDTH * end:
            return float(values[k]), float(t[k])
        low, high, count = t[max(k - 1, 0)], t[min(k + 1, t.size - 1)], FINER_INSTANTS


@compiled
def _singular_values(chain: Chain, c: Array, knots: Array, t: Array, out: Array) -> None:
    """Compute the smallest singular values of the Jacobian at instants t (k,) of quintics c (6, m, n)."""
    q = np.empty((t.shape[0], c.shape[2]))
    for k in range(t.shape[0]):
        i = min(max(np.searchsorted(knots, t[k], side="right") - 1, 0), c.shape[1] - 1)
        u = t[k] - knots[i]
        for j in range(c.shape[2]):
            value = 0.0
            for power in range(6):
                value = value * u + c[power, i, j]
            q[k, j] = value
    kinematics.singular_values_batch(chain, q, out)
