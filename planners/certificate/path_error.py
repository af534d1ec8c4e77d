"""Path error of a motion: a proved bound on the deviation of the tool at every instant, and the largest value found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.ik.base import Tolerance
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import (
    FEW_INTERVALS,
    Closeness,
    Instants,
    MotionBounds,
    SubdivisionBound,
)
from planners.certificate.chord_search import CHORD_ROOM
from planners.certificate.path_bounds import ComparedInstants, PieceBounds, intervals, joint_intervals
from planners.certificate.projection import BEND, NEAREST_TURN, NOT_ALONG_PATH, Nearest, NearestJoints
from planners.certificate.violation import Violation
from planners.paths.base import Path
from planners.trajectory import Trajectory

ERROR_EXCESS = 1.048
"""Largest ratio of the bound to the largest value found; below 1.05 with rounding."""
ERROR_FLOOR = 1e-9
"""Least value [m or rad] that the excess is relative to: far below the repeatability of any arm."""
ERROR_INTERVALS = 400_000
"""Largest number of intervals: minutes of computing; a motion that needs more has a looser bound."""
LOOK_PARTS = 64
"""Largest number of parts of a piece of the motion in the first search for positions along the path."""
ERROR_ROUNDING = 2e-15
"""Largest rounding error of a computed distance [m] or angle [rad]."""
DISTANCE_AND_TURN = np.array([[0.0, 1.0], [0.0, 1.0], [0.0, 1.0], [1.0, 0.0]] * 4)
"""Matrix from squared differences of two poses (16,) to the squared distance and 8 sin² of half the angle."""


class PathError(NamedTuple):
    """Proved bounds on the tool's distance [m] and angle [rad] to its path, with the largest values found and their times [s].

    The true maximum is between the value found and the bound.
    """

    distance: float
    angle: float
    found_distance: float
    found_angle: float
    t_distance: float
    t_angle: float

    def to_dict(self) -> dict[str, float | None]:
        """Return plain data for files; None for the undefined numbers of a motion without a path."""
        return {name: x if np.isfinite(x) else None for name, x in self._asdict().items()}

    def find_violations(self, tolerance: Tolerance | None) -> list[Violation]:
        """Return the deviations of the tool from its path above the tolerance.

        Parameters
        ----------
        tolerance : (2,) tuple of float, or None
            Largest distance [m] and angle [rad]; None without a tolerance.

        Returns
        -------
        list of Violation
            Empty if the tool stays within the tolerance.
        """
        if tolerance is None:
            return []
        violations: list[Violation] = []
        if not self.distance <= tolerance.position:
            words = f"the tool is up to {self.distance:.3g} m off its path at t = {self.t_distance:.6g} s"
            violations.append(_deviation(words, self.t_distance, self.found_distance, tolerance.position, "m"))
        if not self.angle <= tolerance.rotation:
            words = f"the tool is turned by up to {self.angle:.3g} rad at t = {self.t_angle:.6g} s"
            violations.append(_deviation(words, self.t_angle, self.found_angle, tolerance.rotation, "rad"))
        return violations


def _deviation(words: str, t: float, found: float, tolerance: float, unit: str) -> Violation:
    """Return a deviation whose bound exceeds the tolerance; it is a violation if the largest value found also exceeds it."""
    words = f"{words}, and the tolerance is {tolerance:.3g} {unit}"
    if found > tolerance:
        return Violation(words, t, "path")
    return Violation(f"{words}: the largest value found is {found:.3g} {unit}", t, "not_proved")


class Passage(NamedTuple):
    """A motion along its path: path parameters s (k,) at instants t (k,), some of them knots.

    ``falls`` (m, 4) are stretches on which s(t) decreases between two instants: time and s at their begin and at their end.
    """

    t: Array
    s: Array
    knot: Flags
    falls: Array


def path_error(
    robot: Robot,
    path: Path,
    trajectory: Trajectory,
    bounds: MotionBounds | None = None,
    enough: tuple[float, float] = (ERROR_FLOOR, ERROR_FLOOR),
    turn: float = NEAREST_TURN,
) -> tuple[PathError, Passage]:
    """Return bounds on the distance and the angle between the tool and its path over a motion, and its passage along the path.

    The tool is compared with the path at s(t), which is that of the time law, or else the projection of the whole motion onto
    the path (`planners.certificate.projection`). Between instants the error is bounded by its cubic interpolant and the fourth
    derivatives of both motions (`planners.certificate.bounds`); the bound holds for any s(t). Intervals are divided until it is
    at most 1.05 times the largest value found, or 1 nm (1 nrad).
    """
    bounds = bounds or MotionBounds(robot, trajectory)
    nearest = NearestJoints(robot, path) if path.in_joints else Nearest(path, turn)
    piece, at, knot = _known_positions(nearest, bounds, trajectory) or _search_positions(nearest, bounds)
    errors = _Errors(bounds, path, nearest, np.minimum(enough, ERROR_FLOOR))
    proved = errors.bound(piece, at) + ERROR_ROUNDING
    error = PathError(*(float(x) for x in (*proved, *errors.found, *errors.when)))
    t, s = (np.append(x[: piece.size], x[-1]) for x in (at.t, at.s))
    return error, Passage(t, s, knot, np.concatenate(errors.falls))


Intervals = tuple[Indices, ComparedInstants, Flags]
"""The pieces (k,) of intervals; the one-sided instants at which they begin, then those at which they end; and flags (k + 1,) of
boundaries that are knots of the motion."""


def _known_positions(nearest: Nearest, bounds: MotionBounds, trajectory: Trajectory) -> Intervals | None:
    """Return the pieces of the motion at the positions of its time law; None if those are unknown or of another path."""
    s = trajectory.s
    if s is None:
        return None
    at = _compare(nearest, bounds.ends, np.concatenate([s[:-1], s[1:]]))
    return None if _deviations(at).max() > CHORD_ROOM else (np.arange(s.size - 1), at, np.ones(s.size, np.bool_))


def _search_positions(nearest: Nearest, bounds: MotionBounds) -> Intervals:
    """Return the intervals of a motion whose positions along the path are found by a search."""
    piece, ends, knot = _first_intervals(nearest, bounds)
    guess = nearest.guess(Instants(*(np.concatenate([x[: piece.size], x[-1:]]) for x in ends)))
    return piece, _compare(nearest, ends, np.concatenate([guess[:-1], guess[1:]])), knot


def _compare(nearest: Nearest, side: Instants, guess: Array) -> ComparedInstants:
    """Return the tool at instants, and the nearest positions along the path from a guess."""
    return ComparedInstants(*side, *nearest.places(side, guess))


class _Errors(SubdivisionBound[ComparedInstants]):
    """Distance and angle between tool and path, and the backward stretches of the motion."""

    def __init__(self, bounds: MotionBounds, path: Path, nearest: Nearest, floor: Array) -> None:
        super().__init__(bounds, Closeness(ERROR_EXCESS, floor, ERROR_INTERVALS))
        self._nearest, self._end, self._limits = nearest, path.end, PieceBounds.of(path)
        self._joint_bounds = path.joint_bounds()
        self._fall = np.empty((0, 4))
        self.falls: list[Array] = []

    def between(self, at: ComparedInstants, left: Indices, right: Indices) -> Array:
        out, self._fall = np.empty((left.size, 2)), np.empty((left.size, 4))
        arm, limits = (self._bounds.links, self._bounds.robot.prismatic), self._limits
        intervals(arm, limits, self._end, at, (left, right), out, self._fall)
        if self._joint_bounds is not None:
            joint_intervals(arm, (limits.breaks, self._joint_bounds), self._end, at, (left, right), out)
        return out

    def within(
        self, at: ComparedInstants, piece: Indices, left: Indices, right: Indices, shares: Array
    ) -> ComparedInstants:
        t, guess = _interpolate(shares, at, left, right)
        return _compare(self._nearest, self._bounds.at(piece, t), guess)

    def values(self, side: ComparedInstants) -> Array:
        return _deviations(side)

    @property
    def most_intervals(self) -> int:
        return FEW_INTERVALS if self.found.max() > NOT_ALONG_PATH else super().most_intervals

    def record_closed(self, which: Flags) -> None:
        self.falls.append(self._fall[which & (self._fall[:, 1] > self._fall[:, 3])])


def _deviations(side: ComparedInstants) -> Array:
    """Return the distance and the angle (k, 2) between tool and path at instants."""
    apart = (side.poses - side.path_poses).reshape(-1, 16)
    values = np.sqrt((apart * apart) @ DISTANCE_AND_TURN)
    values[:, 1] = 2.0 * np.arcsin(np.minimum(values[:, 1] / np.sqrt(8.0), 1.0))
    return np.asarray(values)


def _first_intervals(nearest: Nearest, bounds: MotionBounds) -> tuple[Indices, Instants, Flags]:
    """Return intervals in which the motion is within about `BEND` of a straight line: their pieces and one-sided ends.

    Also return which of the k + 1 instants between them are knots of the motion.
    """
    t = bounds.knots
    piece = np.arange(t.size - 1)
    parts = _count_parts(nearest, bounds.ends)
    if parts.max() == 1:
        return piece, bounds.ends, np.ones(t.size, np.bool_)
    which = np.repeat(piece, parts)
    part = np.arange(which.size) - np.repeat(np.cumsum(parts) - parts, parts)
    begin = t[which] + part * (np.diff(t) / parts)[which]
    end = np.where(part + 1 == parts[which], t[which + 1], np.append(begin[1:], t[-1]))
    ends = bounds.at(np.concatenate([which, which]), np.concatenate([begin, end]))
    return which, ends, np.append(part == 0, True)


def _count_parts(nearest: Nearest, ends: Instants) -> Indices:
    """Return the numbers (k,) of equal parts in which the motion is within `BEND` of a straight line, by |a| h²/8."""
    x, v, a = (each.reshape(2, -1, each.shape[1]) for each in nearest.track(ends))
    way, h = x[1] - x[0], np.diff(ends.t.reshape(2, -1), axis=0)[0]
    size = (way * way).sum(axis=1)
    # Acceleration along the line does not bend it, unless the motion turns back beyond its ends.
    onward = ((v * way).sum(axis=2) >= 0.0).all(axis=0) & (size > 0.0)
    along = np.where(onward, (a * way).sum(axis=2) ** 2 / np.where(onward, size, 1.0), 0.0)
    bend = np.sqrt(np.maximum((a * a).sum(axis=2) - along, 0.0).max(axis=0)) * h**2 / 8.0
    return np.asarray(np.clip(np.ceil(np.sqrt(bend / BEND)), 1, LOOK_PARTS), np.int64)


def _interpolate(u: Array, at: ComparedInstants, left: Indices, right: Indices) -> tuple[Array, Array]:
    """Return instants at fractions u of intervals, and s on the cubics through their ends."""
    t0, s0, v0, s1, v1 = at.t[left], at.s[left], at.speed[left], at.s[right], at.speed[right]
    h, w = at.t[right] - t0, 1.0 - u
    s = w * w * ((1.0 + 2.0 * u) * s0 + u * h * v0) + u * u * ((1.0 + 2.0 * w) * s1 - w * h * v1)
    return t0 + u * h, s
