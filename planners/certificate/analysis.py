"""Analysis of a motion: quantities that several parts of a certificate need, each computed once."""

from __future__ import annotations

from collections.abc import Hashable
from functools import cached_property

import numpy as np

from optik.arm.inertia import Load
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array, Flags, Indices
from planners.certificate import checks, peak
from planners.certificate.bounds import FEW_INTERVALS, MotionBounds, ToolSpeedBounds, instants, tool_speed
from planners.certificate.effort import stretch_factor
from planners.certificate.path_error import ERROR_FLOOR, Passage, PathError, path_error
from planners.certificate.projection import NEAREST_TURN
from planners.certificate.segment_speed import segment_speed
from planners.certificate.torque import TORQUE_INTERVALS, TorqueBounds, fourth_bounds_of
from planners.limits.inputs import Enclose, Evaluate, LimitedMotion, TorqueRatios
from planners.paths.base import Path
from planners.trajectory import Trajectory

PATH_INDEPENDENT = ("bounds", "tool_speed", "torques", "jumps", "rest", "peaks")
"""Properties of a `MotionAnalysis` that do not depend on the path."""


class MotionAnalysis(LimitedMotion):
    """A motion of an arm, along a path if it has one, and its computed values.

    `enough` [m, rad] is a small path error. `turn` [m/rad] weighs rotation against position where the tool is projected.
    """

    def __init__(
        self,
        robot: Robot,
        trajectory: Trajectory,
        path: Path | None = None,
        enough: tuple[float, float] = (ERROR_FLOOR, ERROR_FLOOR),
        turn: float = NEAREST_TURN,
    ) -> None:
        self.robot, self.trajectory, self._path = robot, trajectory, path
        self._accuracy = (min(enough[0], ERROR_FLOOR), min(enough[1], ERROR_FLOOR)), turn

    def along_path(self, path: Path | None, enough: tuple[float, float], turn: float = NEAREST_TURN) -> MotionAnalysis:
        """Return the analysis of the same motion along a path; values that do not depend on the path are reused."""
        motion, known = MotionAnalysis(self.robot, self.trajectory, path, enough, turn), vars(self)
        if path is self._path and motion._accuracy == self._accuracy:
            return self
        vars(motion).update({name: known[name] for name in PATH_INDEPENDENT if name in known})
        return motion

    def bare(self) -> MotionAnalysis:
        """Return the analysis of the same motion without its large computed values."""
        motion, known = MotionAnalysis(self.robot, self.trajectory, self._path, *self._accuracy), vars(self)
        vars(motion).update({name: known[name] for name in ("rest", "knot_positions") if name in known})
        return motion

    def slowed(self, factor: float) -> MotionAnalysis:
        """Return the motion stretched in time by a factor."""
        return MotionAnalysis(self.robot, self.trajectory.slowed(factor), self._path, *self._accuracy)

    @property
    def has_path(self) -> bool:
        """Whether the motion has a path."""
        return self._path is not None

    @property
    def path(self) -> Path:
        """The path; raises InvalidInput if there is none."""
        if self._path is None:
            raise InvalidInput("path", "none", "the path of the motion: limits of its segments need it")
        return self._path

    @cached_property
    def along(self) -> tuple[PathError, Passage]:
        """The path error, and the motion's progress along the path."""
        return path_error(self.robot, self.path, self.trajectory, self.bounds, *self._accuracy)

    @cached_property
    def knot_positions(self) -> Array:
        """Path parameter (m + 1,) at the knots of the trajectory [m, or rad]."""
        passage = self.along[1]
        return passage.s[passage.knot]

    @cached_property
    def bounds(self) -> MotionBounds:
        """Bounds on the derivatives of the tool's motion."""
        return MotionBounds(self.robot, self.trajectory)

    @cached_property
    def tool_speed(self) -> ToolSpeedBounds:
        """Proved bounds on the tool's speeds."""
        return tool_speed(self.robot, self.trajectory, self.bounds)

    def tool_speed_bound(self, part: int) -> tuple[float, float]:
        """Return a proved bound on the tool's speed [m/s, rad/s], and the time of the peak [s]."""
        found = self.tool_speed
        return (found.rotation, found.t_rotation) if part else (found.speed, found.t_speed)

    def tool_speed_ratio(self, on_pieces: Array, part: int) -> tuple[float, float]:
        """Return a proved bound on the ratio of the tool's speed to the limits of the path's pieces, and its time [s]."""
        return segment_speed(self.bounds, self.path, self.along[1], on_pieces, part)

    def tool_speed_ends(self, part: int) -> tuple[Array, Array]:
        """Return the tool's speed (m,) at the first and at the last instant of every piece [m/s, rad/s]."""
        rows = slice(3 * part, 3 * part + 3)
        first, last = np.linalg.norm(self.bounds.ends.motion[:, 0, rows], axis=1).reshape(2, -1)
        return first, last

    def states(self, shares: Array) -> tuple[Array, Array]:
        """Return the joints' derivatives (m, k, 6, n) of order 0 to 5 at fractions (k,) of each piece, and the times (m, k)."""
        knots = self.trajectory.knots
        t = knots[:-1, None] + np.diff(knots)[:, None] * shares
        piece = np.repeat(np.arange(knots.size - 1), shares.size)
        return self.joints_at(piece, t.ravel()).reshape(*t.shape, 6, -1), t

    def joints_at(self, piece: Indices, t: Array) -> Array:
        """Return the joints' derivatives (k, 6, n) at instants of given pieces."""
        joints = np.empty((t.size, 6, self.robot.n))
        instants(self.trajectory.padded, piece, t - self.trajectory.knots[piece], joints)
        return joints

    @cached_property
    def peaks(self) -> dict[Hashable, tuple[Array, Array]]:
        """Results of `prove_peaks`, by key."""
        return {}

    def prove_peaks(
        self, key: Hashable, evaluate: Evaluate, enclose: Enclose, excess: float, count: int = 1
    ) -> tuple[Array, Array]:
        """Return proved upper bounds (count,) on peak / limit, a fraction `excess` above the largest found, and times [s]."""
        if key not in self.peaks:
            self.peaks[key] = peak.prove_peaks(self.bounds, evaluate, enclose, excess, count)
        return self.peaks[key]

    def fourth_bounds(self, load: Load, D: Array) -> Array:
        """Return bounds (k, n) on the fourth derivatives of the joint torques from those of the joints (k, 6, n)."""
        return fourth_bounds_of(self.robot, load, D)

    @cached_property
    def torques(self) -> TorqueBounds:
        """Torques and proved bounds on them; raises InvalidInput if the arm's masses are unknown."""
        knots = self.bounds.knots
        piece = np.arange(knots.size - 1)
        ends = (self.joints_at(piece, t) for t in (knots[:-1], knots[1:]))
        return TorqueBounds(self.robot, knots, *ends)

    def torque_ratios(self, bound: Array, *, rate: bool) -> TorqueRatios:
        """Return proved bounds on the ratios of joint torques, or of their rates, to the limits (2, n)."""
        most = FEW_INTERVALS if self.bounds.far_out_of_range else TORQUE_INTERVALS
        return self.torques.bound_ratios(bound, rate=rate, most=most)

    def torque_piece_ratios(self, bound: Array, *, rate: bool) -> Array:
        """Return the ratios (m, n) of joint torques, or of their rates, to the limits: on each piece the larger end value."""
        return self.torques.piece_ratios(bound, rate=rate)

    def torque_stretch(self, bound: Array, *, rate: bool) -> float:
        """Return the least factor by which the motion is stretched in time to respect the torque or rate limits (2, n)."""
        return stretch_factor(self.torques, bound, rate=rate)

    @cached_property
    def jumps(self) -> Flags:
        """Discontinuities (4, m + 1, n) of the joints' derivatives of order 0 to 3 at the knots."""
        return checks.jumps(self.trajectory, self.rest)

    def steps(self, order: int) -> Array:
        """Return the discontinuities (m + 1, n) of the joints' derivative of one order at the knots."""
        return checks.steps(self.trajectory, order)

    @cached_property
    def rest(self) -> tuple[bool, bool]:
        """Whether the motion starts and ends at rest."""
        return checks.rest(self.trajectory)
