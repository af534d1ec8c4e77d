"""SciPy: bounded least squares on the pose error, as users write it, with our forward kinematics and Jacobian."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import LoopPeer
from optik.arm.robot import Robot
from optik.types import Array

LSQ_TOLERANCE = 1e-12
"""``ftol``, ``xtol`` and ``gtol``: with the defaults of 1e-8 some answers miss 1e-6 m and rad."""
LSQ_MARGIN = 1e-9
"""Distance of the initial guess from the limits [rad, m]: least_squares requires it strictly inside its bounds."""
LSQ_CLAIM = 1e-6
"""Norm of the residual below which a user accepts a solution."""


class ScipyLeastSquares(LoopPeer):
    """``scipy.optimize.least_squares(residual, q0, jac, bounds)``."""

    distribution = "scipy"
    package = "scipy"
    settings = (
        "least_squares on our pose error (position, rotation vector) with our compiled forward kinematics and Jacobian, limits "
        f"as bounds, method dogbox, tolerances {LSQ_TOLERANCE:g}: finite differences take twice as long; with its default "
        "method trf a redundant arm takes 400 evaluations instead of 6 from a near start, and a third of the answers "
        "miss 1e-6; no restarts"
    )

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        from scipy.optimize import least_squares

        lower, upper = robot.limits.lower, robot.limits.upper
        inside = (lower + LSQ_MARGIN, upper - LSQ_MARGIN)
        options: dict[str, Any] = dict.fromkeys(("ftol", "xtol", "gtol"), LSQ_TOLERANCE)
        options |= {"bounds": (lower, upper), "method": "dogbox"} | (
            {} if iterations is None else {"max_nfev": iterations}
        )

        def call(target: Array, q0: Array) -> tuple[Array, int, bool]:
            start = np.clip(q0, *inside)
            found = least_squares(
                lambda q: robot.pose_errors(q, target), start, jac=lambda q: -robot.jacobian(q), **options
            )
            # SciPy's own `success` only says that it converged, also away from the target
            return found.x, int(found.nfev), bool(np.linalg.norm(found.fun) <= LSQ_CLAIM)

        self.call = call


METHOD = ScipyLeastSquares
