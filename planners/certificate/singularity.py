"""Smallest singular value of the Jacobian along a motion: its distance to singular configurations."""

from __future__ import annotations

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.kinematics import Chain
from optik.types import Array
from planners.trajectory import Trajectory

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
