"""An outside IK method (a peer) in one file: SciPy's bounded least squares on the pose error."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.ik.base import Solutions, SolverPeer
from optik import se3


class ScipyLeastSquares(SolverPeer):
    """``scipy.optimize.least_squares`` with the limits as bounds and finite differences."""

    distribution = "scipy"
    package = "scipy"
    settings = "least_squares, method trf, bounds = limits, xtol and ftol 1e-12, finite differences"

    def __init__(self, robot):
        from scipy.optimize import least_squares

        bounds = (robot.limits.lower, robot.limits.upper)

        def call(target, q0):
            start = np.clip(q0, bounds[0] + 1e-9, bounds[1] - 1e-9)
            return least_squares(
                lambda q: se3.error(robot.fk(q), target), start, bounds=bounds, xtol=1e-12, ftol=1e-12
            ).x

        self.call = call

    def read(self, raw):
        """Return the solution as an array (1, n). Not timed."""
        return Solutions(raw[None])


METHOD = ScipyLeastSquares
