"""What every Cartesian path is: poses along s, their twists, and the nearest place on it."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.curve import Curve

Array = NDArray[np.float64]


class Path(Curve):
    """A curve of tool poses T_base_tool over s: metres, or radians where the tool only turns.

    ``path(s)`` is the pose (4, 4); ``path(s, 1)`` the twist (v, ω) per unit of s in the base frame, ``path(s, 2)`` and
    ``path(s, 3)`` its derivatives, all (6,).
    """

    parameter = "s"
    unit = "m"

    @abstractmethod
    def nearest(self, poses: Array) -> Array:
        """Where on the path (k,) the poses (k, 4, 4) are nearest to it."""

    def pose(self, s: ArrayLike) -> Array:
        """Poses at s: (4, 4) for a scalar, (k, 4, 4) for an array."""
        return self(s)

    def twist(self, s: ArrayLike, order: int = 1) -> Array:
        """Twists (v, ω) per unit of s in the base frame, or their derivatives (order 2, 3)."""
        return self(s, order)
