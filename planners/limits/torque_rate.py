"""Greatest rate of the torque of every joint."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from optik.types import Array
from planners.certificate.examined import Examined
from planners.limits._extreme import Extreme
from planners.limits._loaded import LoadedLimit
from planners.limits._points import PathPoints
from planners.limits._torque_rows import torque_rate_rows


class TorqueRate(LoadedLimit):
    """Greatest rate of the torque of every joint, without Coulomb friction, which jumps where a joint reverses."""

    name: ClassVar[str] = "torque_rate"
    units: ClassVar[tuple[str, str]] = ("N·m/s", "N/s")
    order: ClassVar[int] = 3
    columns: ClassVar[int] = 6

    def _rows_of(self, at: PathPoints, bound: Array, load: Any) -> Array:
        return torque_rate_rows(at, load) / bound[:, None]

    def _judged(self, motion: Examined, bound: Array) -> Extreme:
        value = np.abs(_sampled(motion)).max(axis=0)
        return Extreme(value, value / bound, np.zeros(value.size))

    def _pieces(self, motion: Examined, bound: Array) -> Array:
        return np.zeros((motion.trajectory.knots.size - 1, motion.robot.n))


def _sampled(motion: Examined) -> Array:
    from optik.dynamics import torques_batch

    t = np.linspace(0.0, motion.trajectory.end, 4001)
    states = np.ascontiguousarray(np.stack([motion.trajectory(t, i) for i in range(4)], axis=1))
    found = []
    for load in motion.robot.loads:
        out = np.empty((t.size, 2, motion.robot.n))
        torques_batch(motion.robot.chain, load.bodies, load.viscous, states, out)
        found.append(np.abs(out[:, 1]))
    return np.asarray(np.maximum(found[0], found[-1]))


METHOD = TorqueRate
"""What the registry builds."""
