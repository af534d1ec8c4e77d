"""Inputs of a limit, computed from a motion and a joint path, and its peak values."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.types import Array, Flags
from planners.paths.base import Path
from planners.trajectory import Trajectory


class Extreme(NamedTuple):
    """Exact peak absolute value of each joint (n,), its ratio to the limit (n,), and its time (n,) [s]."""

    value: Array
    ratio: Array
    time: Array

    def worst(self, names: tuple[str, ...]) -> tuple[float, str, float]:
        """Return the largest ratio, its joint and its time; NaN and an empty name if no joint is limited."""
        if np.isnan(self.ratio).all():
            return float("nan"), "", float("nan")
        i = int(np.nanargmax(self.ratio))
        return float(self.ratio[i]), names[i], float(self.time[i])

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files: lists of n numbers; None for infinite and undefined numbers."""
        return {k: plain(v) for k, v in self._asdict().items()}


class ToolExtreme(NamedTuple):
    """Proved bound on a value of the whole arm, its ratio to the limit (NaN without one), and the time of the peak [s]."""

    value: float
    ratio: float
    time: float

    def worst(self, names: tuple[str, ...]) -> tuple[float, str, float]:
        """Return the ratio, the name of the limited part, and the time."""
        return self.ratio, names[0], self.time

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files; None for an infinite or undefined ratio."""
        return {"value": self.value, "ratio": self.ratio if np.isfinite(self.ratio) else None, "time": self.time}


def plain(values: Array) -> list[float | None]:
    """Return a list of numbers for JSON, with None for infinite and undefined numbers."""
    return [float(v) if np.isfinite(v) else None for v in values]


Evaluate = Callable[[Array], Array]
"""From the joints' derivatives (k, 6, n) to (k, d): the value, then what `Enclose` needs."""
Enclose = Callable[[Array, Array, Array, Array, Array], Array]
"""From two results of `Evaluate` at the ends of intervals, their durations (k,) [s], and bounds on the derivatives of the
links' rotations (k, n + 1, 7) [1/s^i] and of their joints' origins (k, n + 1, 7) [m/s^i], to bounds (k,) on values inside."""


class Gears(NamedTuple):
    """Motors that move several axes together.

    Attributes
    ----------
    matrix : (m, n) array
        Torques of the motors over those of the axes [1].
    turns : (m, n) array
        Velocities of the motors over those of the axes [1].
    inertia, viscous, coulomb : (m,) array
        Inertia of the rotors [kg·m²], viscous [N·m·s/rad] and Coulomb friction [N·m], all at the motors.
    """

    matrix: Array
    turns: Array
    inertia: Array
    viscous: Array
    coulomb: Array


class TorqueRatios(NamedTuple):
    """Torques or their rates over their limits, for every joint (n,); a free joint has a limit of 1.

    Attributes
    ----------
    ratio, found : (n,) array
        The proved bound on the ratio, and the largest ratio found [1].
    time : (n,) array
        Time of the largest ratio found [s].
    upper : (n,) array of bool
        Whether it is the ratio to the upper side.
    """

    ratio: Array
    found: Array
    time: Array
    upper: Flags


class LimitedMotion(Protocol):
    """The values of a motion that limits read; `planners.certificate.analysis.MotionAnalysis` computes each once.

    ``part`` is the part of the tool's twist: 0 for the speed of its point, 1 for that of its rotation.
    """

    robot: Robot
    trajectory: Trajectory

    def of_member(self, robot: Robot, columns: tuple[int, ...]) -> LimitedMotion:
        """Return the motion of one mechanism, by its joints among those of this motion."""

    @property
    def path(self) -> Path:
        """The path of the motion; raises InvalidInput if it has none."""

    @property
    def knot_positions(self) -> Array:
        """Path parameter (m + 1,) at the knots of the trajectory [m, or rad]."""

    @property
    def jumps(self) -> Flags:
        """Discontinuities (4, m + 1, n) of the joints' derivatives of order 0 to 3 at the knots."""

    def steps(self, order: int) -> Array:
        """Return the discontinuities (m + 1, n) of the joints' derivative of one order at the knots."""

    def tool_speed_bound(self, part: int) -> tuple[float, float]:
        """Return a proved bound on the tool's speed [m/s, rad/s], and the time of the peak [s]."""

    def tool_speed_ratio(self, on_pieces: Array, part: int) -> tuple[float, float]:
        """Return a proved bound on the ratio of the tool's speed to the limits of the path's pieces, and its time [s]."""

    def tool_speed_ends(self, part: int) -> tuple[Array, Array]:
        """Return the tool's speed (m,) at the first and at the last instant of every piece [m/s, rad/s]."""

    def states(self, shares: Array) -> tuple[Array, Array]:
        """Return the joints' derivatives (m, k, 6, n) of order 0 to 5 at fractions (k,) of each piece, and the times (m, k)."""

    def prove_peak(self, key: Hashable, evaluate: Evaluate, enclose: Enclose, excess: float) -> tuple[float, float]:
        """Return a proved upper bound on peak / limit, a fraction `excess` above the largest found, and its time [s]."""

    def torque_ratios(self, limit: Array, *, rate: bool, gears: Gears | None = None) -> TorqueRatios:
        """Return proved bounds on the ratios of joint or motor torques, or of their rates, to the limits (2, n)."""

    def torque_piece_ratios(self, limit: Array, *, rate: bool, gears: Gears | None = None) -> Array:
        """Return the ratios (m, n) of these torques, or of their rates, to the limits: on each piece the larger end value."""

    def torque_stretch(self, limit: Array, *, rate: bool, gears: Gears | None = None) -> float:
        """Return the least factor by which the motion is stretched in time to respect the torque or rate limits (2, n)."""


class LimitedPath(Protocol):
    """The values of a joint path q(s) that limits read, such as those of `planners.following.joint_path.JointPath`."""

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
    """Points of a joint path, with each quantity in the rows of limits evaluated once."""

    def __init__(self, joint_path: LimitedPath, s: Array, derivatives: Array | tuple[Array, ...] = ()) -> None:
        self.joint_path, self.s = joint_path, s
        self._derivatives: list[Array] = list(derivatives)
        self.torques: dict[int, Array] = {}  # coefficients of `_torque._coefficients`, by load

    def q(self, order: int = 0) -> Array:
        """Return the configurations or their derivatives in s."""
        while len(self._derivatives) <= order:
            self._derivatives.append(self.joint_path(self.s, len(self._derivatives)))
        return self._derivatives[order]

    @cached_property
    def twist(self) -> Array:
        """Twists (k, 6) of the tool per unit of s: (v, ω), linear first."""
        if self.joint_path.path.asked == "pose":
            return self.joint_path.path.twist(self.s)
        return np.asarray(np.einsum("kij,kj->ki", self.joint_path.robot.jacobian(self.q()), self.q(1)))
