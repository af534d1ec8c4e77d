"""SciPy: bounded least squares on the pose error, as users write it, with our forward kinematics and Jacobian."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import Peer, one
from optik.arm.robot import Robot
from optik.types import Array

LSQ_TOLERANCE = 1e-12
"""``ftol``, ``xtol`` and ``gtol``: with the defaults of 1e-8 some answers miss 1e-6 m and rad."""
LSQ_MARGIN = 1e-9
"""Distance of the start from the limits [rad, m]: least_squares wants it strictly inside its bounds."""
LSQ_CLAIM = 1e-6
"""Norm of the residual below which a user takes the answer as a solution."""


class ScipyLeastSquares(Peer):
    """``scipy.optimize.least_squares(residual, q0, jac, bounds)``."""

    distribution = "scipy"
    package = "scipy"
    settings = (
        "least_squares on our pose error (position, rotation vector) with our compiled forward kinematics and Jacobian, limits "
        f"as bounds, method dogbox, tolerances {LSQ_TOLERANCE:g}: finite differences take twice as long; with its default "
        "method trf a redundant arm takes 400 evaluations instead of 6 from a near start, and a third of the answers "
        "miss 1e-6; no restarts"
    )
    budgeted = True

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        from scipy.optimize import least_squares

        lower, upper = robot.limits.lower, robot.limits.upper
        inside = (lower + LSQ_MARGIN, upper - LSQ_MARGIN)
        options: dict[str, Any] = dict.fromkeys(("ftol", "xtol", "gtol"), LSQ_TOLERANCE)
        options |= {"bounds": (lower, upper), "method": "dogbox"} | (
            {} if iterations is None else {"max_nfev": iterations}
        )

        def call(target: Array, q0: Array) -> Any:
            start = np.clip(q0, *inside)
            return least_squares(lambda q: robot.errors(q, target), start, jac=lambda q: -robot.jacobian(q), **options)

        self.call = call

    def answers(self, raw: Any) -> Array:
        """The configuration at which the optimiser ended.

        Parameters
        ----------
        raw : Any
            Return value of `call`.

        Returns
        -------
        (1, n) array
            Configurations [rad, m].
        """
        return one(raw.x)

    def iterations(self, raw: Any) -> int | None:
        """Number of evaluations of the residual.

        Parameters
        ----------
        raw : Any
            Return value of `call`.

        Returns
        -------
        int or None
            Number of iterations.
        """
        return int(raw.nfev)

    def claims(self, raw: Any) -> bool | None:
        """Whether the residual at the answer is within the tolerance: SciPy's ``success`` only says that it converged.

        Parameters
        ----------
        raw : Any
            Return value of `call`.

        Returns
        -------
        bool or None
            Its own claim.
        """
        return bool(np.linalg.norm(raw.fun) <= LSQ_CLAIM)


METHOD = ScipyLeastSquares
