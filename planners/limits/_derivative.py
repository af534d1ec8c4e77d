"""Limits on a derivative of every joint in time."""

from __future__ import annotations

import numpy as np

from optik.types import Array, Flags
from planners.certificate.continuity import steps
from planners.certificate.examined import Examined
from planners.curve import chain_rows
from planners.limits._extreme import Extreme
from planners.limits._points import PathPoints
from planners.limits.base import Limit, scale_of


class DerivativeLimit(Limit):
    """A limit on a derivative of every joint in time: the exact extrema of the polynomials judge it."""

    def rows(self, at: PathPoints, bound: Array) -> Array:
        """The chain rule's coefficients over the bound; see `Limit.rows`.

        Parameters
        ----------
        at : PathPoints
            Points of the joint path.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        (k, m, order) array
            [as 1 over the monomials].
        """
        return chain_rows([at.q(order) for order in range(1, self.order + 1)]) / bound[:, None]

    def judge(self, motion: Examined, bound: Array) -> Extreme:
        """Exact extrema; infinite where a lower derivative jumps. See `Limit.judge`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        Extreme
            Value, ratio and time.
        """
        extrema = motion.trajectory.extrema(self.order)
        ratio = np.where(np.isfinite(bound), extrema.worst / bound, np.nan)
        extreme = Extreme(extrema.worst, ratio, extrema.t_worst)
        for order in range(self.order):
            if motion.jumps[order].any():
                extreme = _infinite_at_jumps(motion, order, extreme, motion.jumps[order], bound)
        return extreme

    def piece_ratios(self, motion: Examined, bound: Array) -> Array:
        """Exact worst values of each piece over the bound; see `Limit.piece_ratios`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        (pieces, m) array
            Ratios [1].
        """
        return motion.trajectory.piece_worst(self.order) / bound

    def slowing(self, motion: Examined, bound: Array) -> float:
        """From the exact extrema inside the pieces, whatever jumps between them; see `Limit.slowing`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        float
            Factor of the duration [1].
        """
        return scale_of(float(self.piece_ratios(motion, bound).max()), self.order)


def _infinite_at_jumps(motion: Examined, order: int, extreme: Extreme, jumps: Flags, bound: Array) -> Extreme:
    """Extreme with infinite values at the largest jump of each joint that jumps in a derivative of this order."""
    trajectory = motion.trajectory
    size = np.where(jumps, np.abs(steps(trajectory, order)), 0.0)
    jumping = jumps.any(axis=0)
    when = trajectory.knots[size.argmax(axis=0)]
    infinite = np.where(np.isfinite(bound), np.inf, np.nan)
    return Extreme(
        np.where(jumping, np.inf, extreme.value),
        np.where(jumping, infinite, extreme.ratio),
        np.where(jumping, when, extreme.time),
    )
