"""Points of a joint path with all that the rows of limits are made from, each evaluated once."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.types import Array
from planners.paths.base import Path


class LimitedPath(Protocol):
    """What a limit reads of a joint path q(s); `planners.following.joint_path.JointPath` is one."""

    @property
    def robot(self) -> Robot:
        """The arm."""

    @property
    def path(self) -> Path:
        """The tool's path."""

    @property
    def end(self) -> float:
        """Path parameter at the end [m, or rad]."""

    def __call__(self, x: ArrayLike, order: int = 0) -> Array:
        """Return q or one of its derivatives in s (k, n)."""


class PathPoints:
    """A joint path at places."""

    def __init__(self, joint_path: LimitedPath, s: Array, derivatives: Array | tuple[Array, ...] = ()) -> None:
        self.joint_path, self.s = joint_path, s
        self._derivatives: list[Array] = list(derivatives)
        self.torques: dict[int, Array] = {}  # what `_torque_rows` found here, by load

    def q(self, order: int = 0) -> Array:
        """Configurations or their derivatives in s."""
        while len(self._derivatives) <= order:
            self._derivatives.append(self.joint_path(self.s, len(self._derivatives)))
        return self._derivatives[order]

    @cached_property
    def twist(self) -> Array:
        """Twists (k, 6) of the path per unit of s: (v, ω), linear first."""
        return self.joint_path.path.twist(self.s)
