"""A limit in one file: the weighted sum of the joint speeds, for example of the flow that hydraulic joints draw together.

Try it: ``optik plan line --limit examples/plugins/weighted_speed.py=1``, ``MotionLimits(extra={"./weighted_speed.py": 3.0})``.
"""

import numpy as np

from planners.limits import Limit, ToolExtreme

WEIGHTS = np.array([3.0, 2.0, 2.0, 1.0, 1.0, 0.5])
"""Weights of the joints, for an arm with six joints."""


class WeightedSpeed(Limit):
    """Limit on Σ w |q̇| [rad/s]: one number for the whole arm, of first order."""

    units = ("rad/s", "rad/s")
    order = 1
    subject = "arm"

    def rows(self, at, limit):
        """Return the rows (k, 1, 1): Σ w |q'| / limit, which times ṡ is at most 1."""
        return (np.abs(at.q(1)) @ WEIGHTS)[:, None, None] / limit[0]

    def piece_ratios(self, motion, limit):
        """Return the greatest ratio on each piece (m, 1): the sum of the greatest speeds is an upper bound."""
        return (motion.trajectory.piece_worst(1) @ WEIGHTS)[:, None] / limit

    def judge(self, motion, limit):
        """Return the greatest sum, its ratio to the limit, and the time at which its piece begins."""
        ratios = self.piece_ratios(motion, limit)[:, 0]
        k = int(ratios.argmax())
        return ToolExtreme(float(ratios[k] * limit[0]), float(ratios[k]), float(motion.trajectory.knots[k]))


METHOD = WeightedSpeed
