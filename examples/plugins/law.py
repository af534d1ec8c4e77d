"""A time law in one file: slow where joints are in the middle of their ranges, within the limits.

Try it: ``optik plan line --timing examples/plugins/law.py``.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BPoly, CubicSpline, PPoly

from planners import stretch_to_limits
from planners.limits import DERIVATIVES
from planners.timing import TimeLaw
from planners.timing.base import refit


class SlowMiddle(TimeLaw):
    """Slow where joints are in the middle of their ranges: time per distance grows with 1 − x², x = ±1 at the limits.

    Parameters
    ----------
    slowness : float
        Additional time per distance if all joints are in the middle, relative to all at a limit [1].
    """

    enforced = DERIVATIVES  # the certificate checks velocity, acceleration and jerk

    def __init__(self, *, slowness=2.0):
        self.slowness = slowness

    def _time(self, joint_path, limits):
        """Time the joint path."""
        shape = refit(joint_path, self._progress(joint_path))
        return stretch_to_limits(joint_path.robot, shape, limits, self.enforced)  # as fast as the limits allow

    def _progress(self, joint_path):
        """s(t) over one second: a minimum-jerk motion in the variable whose density is the time per distance."""
        s = np.linspace(0.0, joint_path.end, 401)
        lower, upper = joint_path.robot.limits.lower, joint_path.robot.limits.upper
        x = (2.0 * joint_path(s) - lower - upper) / (upper - lower)
        density = CubicSpline(s, 1.0 + self.slowness * np.mean(np.maximum(1.0 - x * x, 0.0), axis=1))
        passed = density.antiderivative()
        t = np.linspace(0.0, 1.0, 101)
        u, du, ddu = passed(s[-1]) * np.array([
            t**3 * (10.0 - 15.0 * t + 6.0 * t**2), 30.0 * t**2 * (1.0 - t) ** 2, 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t)
        ])  # fmt: skip
        at = np.interp(u, passed(s), s)
        for _ in range(4):  # Newton: solve passed(at) = u
            at = np.clip(at - (passed(at) - u) / density(at), 0.0, s[-1])
        ds = du / density(at)
        dds = (ddu - ds * ds * density(at, 1)) / density(at)
        return PPoly.from_bernstein_basis(BPoly.from_derivatives(t, np.column_stack([at, ds, dds])))


METHOD = SlowMiddle
