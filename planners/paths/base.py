"""Base class of the paths: poses of the tool along s, their twists, and bounds on their derivatives."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.plain import describe_difference
from optik.arm.robot import Robot
from optik.check import check_kind, finite_array
from optik.errors import InvalidInput
from optik.types import Array
from planners.paths.poses import find_nearest_on_path
from planners.trajectory.curve import Curve

Asked = Literal["pose", "axis", "point"]
"""What the tool must meet of a path: its poses, its points and the directions of its axes z, or its points alone."""
ASKED: tuple[str, ...] = get_args(Asked)
"""Values of `Path.asked`."""


class Path(Curve):
    """A curve of tool poses T_base_tool over s, in metres, or in radians where the tool only turns.

    ``path(s)`` is the pose (4, 4); ``path(s, 1)`` the twist (v, ω) per unit of s in the base frame, ``path(s, 2)`` and
    ``path(s, 3)`` its derivatives, all (6,). All of them are continuous.

    A path is one module with a subclass of `Path` and the line ``METHOD = <the class>``. The subclass needs

    - ``name``, the name of the module;
    - ``end``, the length of the path;
    - ``_evaluate(x, order)`` for x (k,) in [0, end]: poses (k, 4, 4) for order 0, twists (k, 6) and their first and
      second derivatives for orders 1 to 3;
    - ``derivative_bounds``, which must be true bounds, since certificates depend on them;
    - ``to_dict`` and ``from_dict``, plain data for files and back.

    ``breaks`` and ``piece_bounds`` are for paths of several pieces, ``turns_only`` and ``unit = "rad"`` for those
    whose tool only turns, ``_nearest`` for those with a closed form of it. A whole path, in a file ``wave.py``::

        import numpy as np

        from planners.paths.base import Path, fields


        class Wave(Path):
            name = "wave"

            def __init__(self, start, length, height):
                self.start, self.length, self.height = np.array(start), float(length), float(height)
                self.k = 2.0 * np.pi / self.length

            @property
            def end(self):
                return self.length

            def _evaluate(self, x, order):
                rise = self.height * self.k**order * np.sin(self.k * x + 0.5 * np.pi * order)
                if order:
                    twist = np.zeros((x.size, 6))
                    twist[:, 0], twist[:, 2] = order == 1, rise
                    return twist
                pose = np.tile(self.start, (x.size, 1, 1))
                pose[:, 0, 3] += x
                pose[:, 2, 3] += rise
                return pose

            def derivative_bounds(self):
                position = abs(self.height) * self.k ** np.arange(1, 5)
                position[0] = np.hypot(1.0, position[0])
                return np.stack([position, np.zeros(4)])

            def to_dict(self):
                return {
                    "path": self.name, "start": self.start.tolist(), "length": self.length, "height": self.height
                }

            @classmethod
            def from_dict(cls, data, robot=None):
                return cls(*fields(data, cls.name, "start", "length", "height"))


        METHOD = Wave

    Attributes
    ----------
    name : str
        Name of the path's module, which files record.
    unit : {"m", "rad"}
        Unit of s.
    turns_only : bool
        Whether s counts the tool's rotation [rad], because its point does not move.
    segments : int
        Number of segments with their own speed limits.
    in_joints : bool
        Whether a certificate finds s from the joints instead of the tool, which may rest on such a path.
    density : float
        Grid intervals of the law `optimal` over its default: narrow corners need more.
    asked : {"pose", "axis", "point"}
        What the tool must meet: the pose, the point and the direction of axis z, or the point alone.
    dropped : tuple of int
        Indices of given points that were merged with their neighbours.
    """

    parameter = "s"
    unit = "m"
    turns_only = False
    segments = 1
    in_joints = False
    density = 1.0
    asked: Asked = "pose"
    dropped: tuple[int, ...] = ()
    name: ClassVar[str]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.end:.4g} {self.unit})"

    @property
    def breaks(self) -> Array:
        """Values of s (k,) between which the path is smooth, both ends included; ``path(s, 3)`` is continuous there too."""
        return np.array([0.0, self.end])

    @abstractmethod
    def derivative_bounds(self) -> Array:
        """Return bounds (2, 4) on |dᵏp/dsᵏ| of the position and ‖dᵏR/dsᵏ‖₂ of the rotation, k = 1…4, on the whole path.

        They must be proved, not sampled: certificates depend on them. At a break they hold on both sides.
        """

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) as `derivative_bounds`, for each piece between two breaks."""
        return np.tile(self.derivative_bounds(), (self.breaks.size - 1, 1, 1))

    @cached_property
    def known_bounds(self) -> Array:
        """Return `piece_bounds`, computed once."""
        return np.ascontiguousarray(self.piece_bounds())

    def least_on_pieces(self, values: Array) -> Array:
        """Return values of the pieces between breaks: for each the least value of the segments that it is part of.

        Parameters
        ----------
        values : (segments,) array
            One value for each segment [as they are].

        Returns
        -------
        (k - 1,) array
            One value for each piece [as values].
        """
        return np.full(self.breaks.size - 1, values.min())

    def grid(self, count: int, per_piece: int) -> Array:
        """Return values of s at equal intervals of the whole path, and of each piece.

        Parameters
        ----------
        count : int
            Number of equal intervals of the whole path.
        per_piece : int
            Number of equal intervals between any two breaks.

        Returns
        -------
        (k,) array
            Increasing, from 0 to the end [m, or rad].
        """
        breaks, u = self.breaks, np.arange(per_piece) / per_piece
        within = breaks[:-1, None] + np.diff(breaks)[:, None] * u
        s = np.union1d(np.linspace(0.0, self.end, count + 1), within.ravel())
        return np.asarray(s[np.append(np.diff(s) > 1e-9 * self.end, True)])  # values that differ by rounding are one

    def nearest(self, poses: ArrayLike) -> Array:
        """Return the path parameters of poses projected onto the path.

        The projection is by position, and by rotation where the tool only turns.

        Parameters
        ----------
        poses : (k, 4, 4) array
            T_base_tool [m].

        Returns
        -------
        (k,) array
            In [0, end] [m, or rad].

        Raises
        ------
        InvalidInput
            Another shape, NaN or infinity.
        """
        T = finite_array(poses, "poses", "finite poses (k, 4, 4)", (..., 4, 4))
        if T.ndim != 3:
            raise InvalidInput("poses", f"shape {T.shape}", "poses of shape (k, 4, 4)")
        return self._nearest(T) if self.end and len(T) else np.zeros(len(T))

    def _nearest(self, poses: Array) -> Array:
        """Return s (k,) nearest to checked poses on a path of positive length; paths with a closed form override it."""
        return find_nearest_on_path(self, poses)

    def configurations(self, robot: Robot, s: ArrayLike, order: int = 0) -> Array | None:
        """Return configurations at s, or their derivatives, of a path in joint space.

        Parameters
        ----------
        robot : Robot
            The arm.
        s : (k,) array
            Path parameters [m, or rad].
        order : int
            0 for configurations, 1 to 3 for their derivatives.

        Returns
        -------
        (k, n) array or None
            Configurations [rad, m] or derivatives per unit of s; None for a Cartesian path.
        """
        return None

    @property
    def nodes(self) -> Array | None:
        """Path parameters (k,) of the nodes of a path in joint space; None for equally spaced ones."""
        return None

    def joint_bounds(self) -> Array | None:
        """Return bounds (k − 1, 4, n) on |dᵏq/dsᵏ|, k = 1…4, of a path in joint space between its breaks; None if unknown."""
        return None

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files, with the path's name in ``path``; read back, the poses are equal to the last bit."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the path that `to_dict` wrote.

        Parameters
        ----------
        data : mapping
            Plain data.
        robot : Robot, optional
            The arm; a path in joint space needs it.

        Returns
        -------
        Path
            With poses equal to the last bit.

        Raises
        ------
        InvalidInput
            Data that describe no such path, or no arm where one is needed.
        """

    def pose(self, s: ArrayLike) -> Array:
        """Return poses at s.

        Parameters
        ----------
        s : float or (k,) array
            Path parameters [m, or rad].

        Returns
        -------
        (4, 4) or (k, 4, 4) array
            T_base_tool [m].
        """
        return self(s)

    def twist(self, s: ArrayLike, order: int = 1) -> Array:
        """Return twists (v, ω) in the base frame, or their derivatives.

        Parameters
        ----------
        s : float or (k,) array
            Path parameters [m, or rad].
        order : int
            1 for the twist, 2 and 3 for its first and second derivative.

        Returns
        -------
        (6,) or (k, 6) array
            Per unit of s [1, rad/m].
        """
        return self(s, order)

    def frames(self, s: Array) -> tuple[Array, Array]:
        """Return poses and twists without checking s, for inner loops.

        Parameters
        ----------
        s : (k,) array
            In [0, end] [m, or rad].

        Returns
        -------
        poses : (k, 4, 4) array
            T_base_tool [m].
        twists : (k, 6) array
            Per unit of s [1, rad/m].
        """
        return self._evaluate(s, 0), self._evaluate(s, 1)


class PiecewisePath(Path):
    """A path of several pieces, each with its own bounds."""

    @abstractmethod
    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) on the derivatives of position and rotation between two breaks."""

    def derivative_bounds(self) -> Array:
        """Return bounds (2, 4) on the derivatives of position and rotation: the greatest of all pieces."""
        return np.asarray(self.piece_bounds().max(axis=0))


def check_robot(robot: Any) -> None:
    """Raise InvalidInput unless a value is an arm."""
    check_kind(robot, "robot", Robot)


def check_recorded(robot: Robot | None, name: str, fingerprint: str) -> Robot:
    """Return an arm; raise InvalidInput unless it is the one that a path in joint space was written for."""
    if not isinstance(robot, Robot):
        raise InvalidInput("robot", repr(robot)[:60], f"the arm {name}, because the path is in joint space")
    if robot.fingerprint != fingerprint:
        raise InvalidInput("robot", f"{robot!r} ({robot.fingerprint})", f"the arm {name} ({fingerprint})")
    return robot


def check_arm(robot: Robot, own: Robot) -> None:
    """Raise InvalidInput unless an arm has the kinematics of the arm of a path in joint space."""
    if robot is not own and not all(map(np.array_equal, robot.chain, own.chain)):
        other = f"{robot!r}, which differs in {describe_difference(robot, own)}"
        raise InvalidInput("robot", other, f"the arm of this path, {own!r}")


def fields(data: Any, path: str, *names: str) -> tuple[Any, ...]:
    """Return the named fields of a path's plain data."""
    if not isinstance(data, Mapping) or data.get("path", path) != path:
        raise InvalidInput("data", repr(data)[:60], f"what to_dict of a {path} wrote")
    missing = [name for name in names if name not in data]
    if missing:
        raise InvalidInput("data", f"no {' and no '.join(missing)}", f"{', '.join(names)} of the path {path}")
    return tuple(data[name] for name in names)


METHOD_BASE = Path
"""Base class of the METHOD of every module here and of every plug-in."""
