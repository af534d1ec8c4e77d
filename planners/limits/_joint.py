"""Limits on a time derivative of every joint."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from optik.types import Array, Flags
from planners.curve import chain_rows
from planners.limits._motion import Extreme, LimitedMotion, PathPoints
from planners.limits.base import Limit, center_rows, ratio_to_limit, scale_of, sides, symmetric_bound
from planners.trajectory import Extrema


class DerivativeLimit(Limit):
    """A limit on a time derivative of every joint, judged by the exact extrema of the polynomials inside the pieces.

    The peak value is infinite where a lower derivative jumps.
    """

    def rows(self, at: PathPoints, bound: Array) -> Array:
        rows = chain_rows([at.q(order) for order in range(1, self.order + 1)])
        if bound.ndim == 1:
            return rows / bound[:, None]
        if self.order == 1:  # ṡ ≥ 0: the sign of q' selects the side, and the value keeps its sign
            lower, upper = sides(bound)
            return np.asarray(rows / np.where(rows < 0.0, -lower[:, None], upper[:, None]))
        return center_rows(np.concatenate([rows, np.zeros_like(rows)], axis=2), bound)

    def judge(self, motion: LimitedMotion, bound: Array) -> Extreme:
        extrema = motion.trajectory.extrema(self.order)
        if bound.ndim == 1:
            ratio = np.where(np.isfinite(bound), extrema.worst / bound, np.nan)
            extreme = Extreme(extrema.worst, ratio, extrema.t_worst)
        else:
            extreme = _nearest_side(extrema, bound)
        for order in range(self.order):
            if motion.jumps[order].any():
                extreme = _infinite_at_jumps(motion, order, extreme, motion.jumps[order], bound)
        return extreme

    def piece_ratios(self, motion: LimitedMotion, bound: Array) -> Array:
        if bound.ndim == 1:
            return motion.trajectory.piece_worst(self.order) / bound
        return np.maximum(*(ratio_to_limit(value, bound) for value in motion.trajectory.piece_range(self.order)))

    def stretch_factor(self, motion: LimitedMotion, bound: Array) -> float:
        return scale_of(float(self.piece_ratios(motion, bound).max()), self.order)


def _nearest_side(extrema: Extrema, bound: Array) -> Extreme:
    """Return the least or the greatest value of each joint, whichever has the larger ratio to its side of the bound."""
    free = np.isinf(bound[0])
    lower, upper = np.where(free, -1.0, bound[0]), np.where(free, 1.0, bound[1])
    below, above = extrema.least / lower, extrema.greatest / upper
    down = below > above
    value, time = np.where(down, -extrema.least, extrema.greatest), np.where(down, extrema.t_least, extrema.t_greatest)
    return Extreme(value, np.where(free, np.nan, np.maximum(below, above)), time)


def _infinite_at_jumps(motion: LimitedMotion, order: int, extreme: Extreme, jumps: Flags, bound: Array) -> Extreme:
    """Return an extreme with infinite values at the largest jump of each joint whose derivative of this order jumps."""
    size = np.where(jumps, np.abs(motion.steps(order)), 0.0)
    jumping = jumps.any(axis=0)
    when = motion.trajectory.knots[size.argmax(axis=0)]
    infinite = np.where(np.isfinite(symmetric_bound(bound)), np.inf, np.nan)
    return Extreme(
        np.where(jumping, np.inf, extreme.value),
        np.where(jumping, infinite, extreme.ratio),
        np.where(jumping, when, extreme.time),
    )


class Velocity(DerivativeLimit):
    """Greatest velocity of every joint."""

    name: ClassVar[str] = "velocity"
    units: ClassVar[tuple[str, str]] = ("rad/s", "m/s")
    order: ClassVar[int] = 1
    sided: ClassVar[bool] = True


class Acceleration(DerivativeLimit):
    """Greatest acceleration of every joint."""

    name: ClassVar[str] = "acceleration"
    units: ClassVar[tuple[str, str]] = ("rad/s²", "m/s²")
    order: ClassVar[int] = 2
    sided: ClassVar[bool] = True


class Jerk(DerivativeLimit):
    """Greatest jerk of every joint."""

    name: ClassVar[str] = "jerk"
    units: ClassVar[tuple[str, str]] = ("rad/s³", "m/s³")
    order: ClassVar[int] = 3
