"""An outside time law (a peer) in one file: SciPy's cubic spline through samples, scaled in time to the limits."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.peers.laws.base import TimingPeer
from planners import Trajectory


class ScipySpline(TimingPeer):
    """``CubicSpline`` through 41 samples at minimum-jerk progress, at rest at both ends."""

    distribution = "scipy"
    package = "scipy"
    settings = (
        "CubicSpline(bc_type='clamped') through 41 samples, scaled in time to the velocity and acceleration limits"
    )
    enforced = ("velocity", "acceleration")

    def __init__(self, limits):
        from scipy.interpolate import CubicSpline

        self._spline, self._limits = CubicSpline, limits

    def call(self, joint_path):
        """Time a joint path from rest to rest; this is what is timed."""
        t = np.linspace(0.0, 1.0, 41)
        u = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
        spline = self._spline(t, joint_path(u * joint_path.end), bc_type="clamped")
        spline = PPoly(spline.c, spline.x)
        ratios = []
        for order, limit in enumerate((self._limits["velocity"], self._limits["acceleration"]), start=1):
            most = Trajectory(spline).extrema(order).worst
            ratios.append((most / limit).max() ** (1.0 / order))
        return spline, max(ratios) * (1.0 + 1e-12)

    def read(self, joint_path, raw):
        """Return the motion of a call. Not timed."""
        spline, duration = raw
        return Trajectory(spline).stretched(duration)


METHOD = ScipySpline
