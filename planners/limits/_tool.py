"""Limits on the speed of the tool, one bound or one for each segment of a path."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import check_positive
from optik.arm.plain import read_numbers
from optik.errors import InvalidInput
from optik.types import Array
from planners.limits.base import Limit, LimitedMotion, PathPoints, ToolExtreme
from planners.paths.base import Path

AT_BREAK = 1e-9
"""Fraction of the path around a break in which the lesser of both bounds holds: a law reaches the break only to rounding."""


class ToolSpeedLimit(Limit):
    """A limit on the Euclidean norm of a part of the tool's twist, judged by proved bounds.

    It has one bound (1,), or one for each segment of the path (k,).

    Attributes
    ----------
    part : int
        Part of the twist: 0 for v, 1 for ω.
    """

    part: ClassVar[int]
    order: ClassVar[int] = 1
    subject: ClassVar[str | None] = "tool"

    def check(self, value: Any) -> Any:
        if not isinstance(value, list | tuple | np.ndarray) or (isinstance(value, np.ndarray) and value.ndim == 0):
            return super().check(value)
        each = check_positive(value, len(value), self.name) if len(value) else np.zeros(0)
        if not each.size:
            raise InvalidInput(self.name, "no numbers", "a number above 0, or one for each segment of the path")
        return float(each[0]) if each.size == 1 else each

    def array(self, value: ArrayLike | None, n: int) -> Array:
        bound = np.inf if value is None else value
        return check_positive(bound, np.size(bound), self.name)

    def from_plain(self, data: Any, n: int) -> Array | float | None:
        if isinstance(data, list):
            return read_numbers(data, (len(data),), f"limits.{self.name}")
        return super().from_plain(data, n)

    def rows(self, at: PathPoints, bound: Array) -> Array:
        norm = (
            np.linalg.norm(at.twist[:, 3 * self.part : 3 * self.part + 3], axis=1)
            if np.isfinite(bound).any()
            else np.zeros(at.s.size)
        )
        here = bound[0] if bound.size == 1 else bound_at(at.joint_path.path, bound, at.s, self.name)
        return np.asarray((norm / here)[:, None, None])

    def judge(self, motion: LimitedMotion, bound: Array) -> ToolExtreme:
        value, time = motion.tool_speed_bound(self.part)
        if not np.isfinite(bound).any():
            return ToolExtreme(value, float("nan"), time)
        if bound.size == 1:
            return ToolExtreme(value, value / float(bound[0]), time)
        ratio, time = motion.tool_speed_ratio(bounds_on_pieces(motion.path, bound, self.name), self.part)
        return ToolExtreme(value, ratio, time)

    def piece_ratios(self, motion: LimitedMotion, bound: Array) -> Array:
        speeds = motion.tool_speed_ends(self.part)
        if bound.size == 1:
            return np.asarray(np.maximum(*speeds)[:, None] / bound)
        allowed = inside_ends(motion.path, bound, motion.knot_positions, self.name)
        return np.asarray(np.maximum(*(v / most for v, most in zip(speeds, allowed, strict=True)))[:, None])


def bounds_on_pieces(path: Path, bound: Array, name: str) -> Array:
    """Return the bounds on the pieces between a path's breaks; the lesser one on a piece that belongs to two segments."""
    if bound.size != path.segments:
        several = f"{path.segments} numbers, one for each segment of the {path.name}, or one number"
        one = f"one number: a {path.name} has one segment"
        raise InvalidInput(f"limits.{name}", f"{bound.size} numbers", several if path.segments > 1 else one)
    return path.least_on_pieces(bound)


def bound_at(path: Path, bound: Array, s: Array, name: str) -> Array:
    """Return the bounds at positions along a path; at a break the lesser of both sides."""
    pieces, inner, near = bounds_on_pieces(path, bound, name), path.breaks[1:-1], AT_BREAK * path.end
    return np.minimum(pieces[np.searchsorted(inner, s - near)], pieces[np.searchsorted(inner, s + near)])


def inside_ends(path: Path, bound: Array, s: Array, name: str) -> tuple[Array, Array]:
    """Return the bounds just after the start, and just before the end, of intervals of a path."""
    pieces, inner, near = bounds_on_pieces(path, bound, name), path.breaks[1:-1], AT_BREAK * path.end
    return pieces[np.searchsorted(inner, s[:-1] + near)], pieces[np.searchsorted(inner, s[1:] - near)]


class ToolSpeed(ToolSpeedLimit):
    """Greatest speed |v| of the tool's point."""

    name: ClassVar[str] = "tool_speed"
    units: ClassVar[tuple[str, str]] = ("m/s", "m/s")
    part: ClassVar[int] = 0


class RotationSpeed(ToolSpeedLimit):
    """Greatest speed |ω| of the tool's rotation."""

    name: ClassVar[str] = "rotation_speed"
    units: ClassVar[tuple[str, str]] = ("rad/s", "rad/s")
    part: ClassVar[int] = 1
