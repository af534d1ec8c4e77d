"""Limits of a motion: of every joint, and of the tool."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import positive
from optik.arm.robot import Robot
from optik.check import check_number
from optik.content import content
from optik.types import Array

DERIVATIVES = ("velocity", "acceleration", "jerk")
"""Limits of every joint."""
TOOL_SPEEDS = ("tool_speed", "rotation_speed")
"""Limits of the tool, on the Euclidean norms of v and ω."""
ALL_LIMITS = (*DERIVATIVES, *TOOL_SPEEDS)
SAME_SPEED = 1e-6
"""Share by which a tool speed that was asked may come out as another: whole nanoseconds, and rounding."""


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of a motion, symmetric, per joint; None where free.

    Parameters
    ----------
    velocity, acceleration, jerk : scalar or (n,) array, optional
        [rad/s, rad/s², rad/s³, or metres for prismatic joints].
    tool_speed, rotation_speed : float, optional
        Greatest speed of the tool's point [m/s] and of its rotation [rad/s], as Euclidean norms.

    Raises
    ------
    InvalidInput
        Limits that are not above 0, or not numbers.
    """

    velocity: ArrayLike | None = None
    acceleration: ArrayLike | None = None
    jerk: ArrayLike | None = None
    tool_speed: float | None = None
    rotation_speed: float | None = None

    def __post_init__(self) -> None:
        for field in DERIVATIVES:
            value = getattr(self, field)
            if value is not None:
                kept = positive(value, np.size(value), field)
                object.__setattr__(self, field, kept if np.ndim(value) else float(kept[0]))
        for field in TOOL_SPEEDS:
            value = getattr(self, field)
            if value is not None:
                check_number(value, field, "a speed above 0", above=0.0)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MotionLimits) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    def _content(self) -> Any:
        return content([getattr(self, field) for field in ALL_LIMITS])

    @staticmethod
    def of(robot: Robot) -> MotionLimits:
        """Return the robot's own limits."""
        return MotionLimits(robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk)

    def arrays(self, n: int) -> dict[str, Array]:
        """Return each as (n,), infinity where free; read-only.

        Raises
        ------
        InvalidInput
            A length other than n.
        """
        kept: dict[int, dict[str, Array]] = self.__dict__.setdefault("_arrays", {})  # asked for many times by a law
        if n not in kept:
            free = np.full(n, np.inf)
            free.setflags(write=False)
            kept[n] = {f: free if (v := getattr(self, f)) is None else positive(v, n, f) for f in DERIVATIVES}
        return dict(kept[n])

    def scaled(self, share: float) -> MotionLimits:
        """Return the same limits, so many times as wide."""
        wider: dict[str, Any] = {f: share * np.asarray(v) for f in ALL_LIMITS if (v := getattr(self, f)) is not None}
        return replace(self, **{f: float(v) if f in TOOL_SPEEDS else v for f, v in wider.items()})

    def to_dict(self, n: int) -> dict[str, Any]:
        """Plain data for files: lists of n numbers, None where free."""
        arrays = {f: [float(x) if np.isfinite(x) else None for x in a] for f, a in self.arrays(n).items()}
        return arrays | {f: getattr(self, f) for f in TOOL_SPEEDS}

    @property
    def tool(self) -> tuple[float, float]:
        """Greatest tool speed [m/s] and rotation speed [rad/s], infinity where free."""
        speed, rotation = (getattr(self, f) for f in TOOL_SPEEDS)
        return (np.inf if speed is None else float(speed), np.inf if rotation is None else float(rotation))
