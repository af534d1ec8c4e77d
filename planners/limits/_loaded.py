"""What the limits on torque and on its rate share: they are on the loads of an arm whose masses are known."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from optik.arm.inertia import Load
from optik.types import Array
from planners.limits._extreme import Extreme
from planners.limits._motion import LimitedMotion
from planners.limits._points import PathPoints
from planners.limits._sides import sides
from planners.limits.base import Limit


class LoadedLimit(Limit):
    """A limit on a value of every joint that its masses make. It costs nothing where it is free.

    A payload given as an interval is two loads, the lightest and the heaviest: the value is affine in the payload's mass, so
    one of the two is the worst.
    """

    homogeneous: ClassVar[bool] = False
    rate: ClassVar[bool]
    """Whether the limit is on the rates of the torques, and not on the torques."""
    columns: ClassVar[int]
    """Columns of the rows: the full set of monomials of the limit's order."""

    def rows(self, at: PathPoints, bound: Array) -> Array:
        """Coefficients of the value over its bound, those of the second load behind those of the first; see `Limit.rows`."""
        if not np.isfinite(bound).any():
            return np.zeros((at.s.size, 1, self.columns))
        found = [self._rows_of(at, bound, load) for load in at.joint_path.robot.loads]
        return found[0] if len(found) == 1 else np.concatenate(found, axis=1)

    @abstractmethod
    def _rows_of(self, at: PathPoints, bound: Array, load: Load) -> Array:
        """The rows (k, n, columns) of one load."""

    def judge(self, motion: LimitedMotion, bound: Array) -> Extreme:
        """The proved bound; NaN where the limit is free. See `Limit.judge`."""
        if not np.isfinite(bound).any():
            return Extreme(*np.full((3, motion.robot.n), np.nan))
        lower, upper = sides(bound)
        found = motion.torque_ratios(np.stack([lower, upper]), rate=self.rate)
        limited = np.isfinite(upper)
        value = found.ratio * np.where(limited, np.where(found.upper, upper, -lower), 1.0)
        extreme = Extreme(value, np.where(limited, found.ratio, np.nan), found.time)
        jumping = motion.jumps[: self.order].any(axis=(0, 2))
        if not jumping.any():
            return extreme
        infinite = np.full(upper.size, np.inf)
        when = np.full(upper.size, motion.trajectory.knots[jumping.argmax()])
        return Extreme(infinite, np.where(limited, infinite, np.nan), when)

    def piece_ratios(self, motion: LimitedMotion, bound: Array) -> Array:
        """The larger of the ratios at both ends of each piece; see `Limit.piece_ratios`."""
        if not np.isfinite(bound).any():
            return np.zeros((motion.trajectory.knots.size - 1, motion.robot.n))
        return motion.torque_piece_ratios(np.stack(sides(bound)), rate=self.rate)

    def stretch_factor(self, motion: LimitedMotion, bound: Array) -> float:
        """From the parts of the torques that go with powers of the speed; see `Limit.stretch_factor`."""
        if not np.isfinite(bound).any():
            return 0.0
        return motion.torque_stretch(np.stack(sides(bound)), rate=self.rate)
