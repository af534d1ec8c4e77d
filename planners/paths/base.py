"""What every path is: poses of the tool along s, their twists, and bounds on how fast they change."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import real_array
from optik.errors import InvalidInput
from optik.types import Array
from planners.curve import Curve
from planners.paths._nearest import nearest_places


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

        They are proved, not sampled: certificates rest on them. At a break they hold on either side.
        """

    def piece_bounds(self) -> Array:
        """`derivative_bounds` of each piece between two breaks, (k − 1, 2, 4); a sharp corner is felt only there."""
        return np.tile(self.derivative_bounds(), (self.breaks.size - 1, 1, 1))

    def places(self, count: int, per_piece: int) -> Array:
        """Places (k,) from 0 to the end: `count` equal intervals, and `per_piece` equal ones between any two breaks."""
        breaks, u = self.breaks, np.arange(per_piece) / per_piece
        within = breaks[:-1, None] + np.diff(breaks)[:, None] * u
        s = np.union1d(np.linspace(0.0, self.end, count + 1), within.ravel())
        return np.asarray(s[np.append(np.diff(s) > 1e-9 * self.end, True)])  # equal but for rounding is equal

    def nearest(self, poses: ArrayLike) -> Array:
        """Where on the path the poses are nearest to it.

        Nearest by position; where the position does not tell places apart (the tool only turns), by rotation.

        Parameters
        ----------
        poses : (k, 4, 4) array
            T_base_tool.

        Returns
        -------
        (k,) array
            Places in [0, end].

        Raises
        ------
        InvalidInput
            Another shape, NaN or infinity.
        """
        T = real_array(poses, "poses", "poses (k, 4, 4)")
        if T.ndim != 3 or T.shape[1:] != (4, 4):
            raise InvalidInput("poses", f"shape {T.shape}", "poses of shape (k, 4, 4)")
        if not np.isfinite(T).all():
            raise InvalidInput("poses", "NaN or infinity in them", "finite poses")
        return self._nearest(T) if self.end and len(T) else np.zeros(len(T))

    def _nearest(self, poses: Array) -> Array:
        """Places (k,) of checked poses on a path with a length: by search; a path with a closed form has its own."""
        return nearest_places(self, poses)

    def configurations(self, robot: Robot, s: ArrayLike, order: int = 0) -> Array | None:
        """Configurations (k, n) at s or their derivatives, for a path that is given in the joints; None for all others."""
        return None

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Plain data for files: ``path`` is the name of the path's file. Read back, the poses are the same to the last bit."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """The path that `to_dict` wrote; a path in the joints needs the arm.

        Raises
        ------
        InvalidInput
            Data that describe no such path, no arm where one is needed.
        """

    def pose(self, s: ArrayLike) -> Array:
        """Poses at s: (4, 4) for a scalar, (k, 4, 4) for an array."""
        return self(s)

    def twist(self, s: ArrayLike, order: int = 1) -> Array:
        """Twists (v, ω) per unit of s in the base frame, or their derivatives (order 2, 3)."""
        return self(s, order)

    def frames(self, s: Array) -> tuple[Array, Array]:
        """Poses (k, 4, 4) and twists (k, 6) at places inside the path, unchecked: for inner loops."""
        return self._evaluate(s, 0), self._evaluate(s, 1)


def fields(data: Any, path: str, *names: str) -> tuple[Any, ...]:
    """Return the named fields of a path's plain data.

    Raises
    ------
    InvalidInput
        No mapping, the data of another path, or a field that is missing.
    """
    if not isinstance(data, Mapping) or data.get("path", path) != path:
        raise InvalidInput("data", repr(data)[:60], f"what to_dict of a {path} wrote")
    missing = [name for name in names if name not in data]
    if missing:
        raise InvalidInput("data", f"no {' and no '.join(missing)}", f"a {path} with {', '.join(names)}")
    return tuple(data[name] for name in names)


METHOD_BASE = Path
"""What the METHOD of every module here, and of every plug-in, is a subclass of."""
