"""Limits on the speed of the tool."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import check_positive
from optik.arm.plain import read_numbers
from optik.errors import InvalidInput
from optik.types import Array
from planners.limits._extreme import ToolExtreme
from planners.limits._motion import LimitedMotion
from planners.limits._points import PathPoints
from planners.limits._segments import bound_at, bounds_on_pieces, inside_ends
from planners.limits.base import Limit


class ToolSpeedLimit(Limit):
    """A limit on the Euclidean norm of a part of the tool's twist: proved bounds judge it.

    It is one bound (1,), or one for each segment of the path (k,).

    Attributes
    ----------
    part : int
        Part of the twist: 0 for v, 1 for ω.
    """

    part: ClassVar[int]
    order: ClassVar[int] = 1
    subject: ClassVar[str | None] = "tool"

    def check(self, value: Any) -> Any:
        """Return a bound as `MotionLimits` keeps it: one, or one for each segment of the path. See `Limit.checked`."""
        if not isinstance(value, list | tuple | np.ndarray) or (isinstance(value, np.ndarray) and value.ndim == 0):
            return super().check(value)
        each = check_positive(value, len(value), self.name) if len(value) else np.zeros(0)
        if not each.size:
            raise InvalidInput(self.name, "no numbers", "a number above 0, or one for each segment of the path")
        return float(each[0]) if each.size == 1 else each

    def array(self, value: ArrayLike | None, n: int) -> Array:
        """Return a bound as an array; see `Limit.array`."""
        bound = np.inf if value is None else value
        return check_positive(bound, np.size(bound), self.name)

    def from_plain(self, data: Any, n: int) -> Array | float | None:
        """Return the bound that `to_plain` wrote; see `Limit.from_plain`."""
        if isinstance(data, list):
            return read_numbers(data, (len(data),), f"limits.{self.name}")
        return super().from_plain(data, n)

    def rows(self, at: PathPoints, bound: Array) -> Array:
        """Norm of the path's twist per unit of s, over the bound; see `Limit.rows`."""
        norm = (
            np.linalg.norm(at.twist[:, 3 * self.part : 3 * self.part + 3], axis=1)
            if np.isfinite(bound).any()
            else np.zeros(at.s.size)
        )
        here = bound[0] if bound.size == 1 else bound_at(at.joint_path.path, bound, at.s, self.name)
        return np.asarray((norm / here)[:, None, None])

    def judge(self, motion: LimitedMotion, bound: Array) -> ToolExtreme:
        """The proved bound on the speed; see `Limit.judge`."""
        value, time = motion.tool_speed_bound(self.part)
        if not np.isfinite(bound).any():
            return ToolExtreme(value, float("nan"), time)
        if bound.size == 1:
            return ToolExtreme(value, value / float(bound[0]), time)
        ratio, time = motion.tool_speed_ratio(bounds_on_pieces(motion.path, bound, self.name), self.part)
        return ToolExtreme(value, ratio, time)

    def piece_ratios(self, motion: LimitedMotion, bound: Array) -> Array:
        """The larger of the ratios at both ends of each piece; see `Limit.piece_ratios`."""
        speeds = motion.tool_speed_ends(self.part)
        if bound.size == 1:
            return np.asarray(np.maximum(*speeds)[:, None] / bound)
        allowed = inside_ends(motion.path, bound, motion.knot_positions, self.name)
        return np.asarray(np.maximum(*(v / most for v, most in zip(speeds, allowed, strict=True)))[:, None])
