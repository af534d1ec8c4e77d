"""What every path is: poses of the tool along s, their twists, and bounds on how fast they change."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik.robot import Robot
from planners.curve import Curve

Array = NDArray[np.float64]


class Path(Curve):
    """A curve of tool poses T_base_tool over s: metres, or radians where the tool only turns.

    ``path(s)`` is the pose (4, 4); ``path(s, 1)`` the twist (v, ω) per unit of s in the base frame, ``path(s, 2)`` and
    ``path(s, 3)`` its derivatives, all (6,). A path is a subclass in a file of its own that names itself ``METHOD``.
    """

    parameter = "s"
    unit = "m"
    name: ClassVar[str]

    @property
    def breaks(self) -> Array:
        """Places (k,) between which the path is smooth, both ends included; twists may jump in ``path(s, 3)`` there."""
        return np.array([0.0, self.end])

    @abstractmethod
    def derivative_bounds(self) -> Array:
        """Bounds (2, 4) that hold everywhere: on |dᵏp/dsᵏ| of the position, and on ‖dᵏR/dsᵏ‖₂ of the rotation, k = 1…4.

        They are proved, not sampled: certificates rest on them.
        """

    @abstractmethod
    def nearest(self, poses: Array) -> Array:
        """Where on the path (k,) the poses (k, 4, 4) are nearest to it."""

    def configurations(self, robot: Robot, s: ArrayLike, order: int = 0) -> Array | None:
        """Configurations (k, n) at s or their derivatives, for a path that is given in the joints; None for all others."""
        return None

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Plain data for files: ``path`` is the name of the path's file."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """The path that `to_dict` wrote.

        Raises
        ------
        InvalidInput
            Data that describe no such path.
        """

    def pose(self, s: ArrayLike) -> Array:
        """Poses at s: (4, 4) for a scalar, (k, 4, 4) for an array."""
        return self(s)

    def twist(self, s: ArrayLike, order: int = 1) -> Array:
        """Twists (v, ω) per unit of s in the base frame, or their derivatives (order 2, 3)."""
        return self(s, order)
