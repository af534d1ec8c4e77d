"""What a limit reads of a motion."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from optik.arm.robot import Robot
from optik.types import Array, Flags
from planners.paths.base import Path
from planners.trajectory import Trajectory


class TorqueRatios(NamedTuple):
    """Torques or their rates over their limits, for every joint (n,); a free joint has a limit of 1.

    Attributes
    ----------
    ratio, found : (n,) array
        The proved bound on the ratio, and the largest ratio found [1].
    time : (n,) array
        Time of the largest ratio found [s].
    upper : (n,) array of bool
        Whether it is on the upper side.
    """

    ratio: Array
    found: Array
    time: Array
    upper: Flags


class LimitedMotion(Protocol):
    """What a limit reads of a motion; `planners.certificate.analysis.MotionAnalysis` computes each value once.

    ``part`` is the part of the tool's twist: 0 for the speed of its point, 1 for that of its rotation.
    """

    robot: Robot
    trajectory: Trajectory

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
        """Return the steps (m + 1, n) of a derivative at the knots."""

    def tool_speed_bound(self, part: int) -> tuple[float, float]:
        """Return a proved bound on the tool's speed [m/s, rad/s], and when it is nearly reached [s]."""

    def tool_speed_ratio(self, on_pieces: Array, part: int) -> tuple[float, float]:
        """Return a proved bound on the tool's speed over the limit of the path's piece, and when it is nearly reached [s]."""

    def tool_speed_ends(self, part: int) -> tuple[Array, Array]:
        """Return the tool's speed (m,) at the first and at the last instant of every piece [m/s, rad/s]."""

    def torque_ratios(self, bound: Array, *, rate: bool) -> TorqueRatios:
        """Return proved bounds on the torques, or on their rates, over the limits (2, n)."""

    def torque_piece_ratios(self, bound: Array, *, rate: bool) -> Array:
        """Return the larger of the ratios (m, n) at both ends of every piece."""

    def torque_stretch(self, bound: Array, *, rate: bool) -> float:
        """Return the least factor by which the motion is stretched in time to respect the limits (2, n)."""
