"""Path error of a motion: a proved bound on the deviation of the tool at every instant, and the largest value found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.ik.base import Tolerance
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import FEW_INTERVALS, NARROWEST_SHARE, Instants, MotionBounds
from planners.certificate.chord_search import CHORD_ROOM
from planners.certificate.path_bounds import ComparedInstants, PieceBounds, compare, divide, intervals, joint_intervals
from planners.certificate.projection import BEND, NEAREST_TURN, NOT_ALONG_PATH, Nearest, PathPositions, make_nearest
from planners.certificate.violation import Violation
from planners.paths.base import Asked, Path
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
MOST_PARTS = 16
"""Largest number of parts into which an interval is divided at once."""


class PathError(NamedTuple):
    """Proved bounds on the tool's distance [m] and angle [rad] to its path, with the largest values found and their times [s].

    The angle is that between the axes z where a path asks point and axis, and only rounding where it asks the point alone.
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
    nearest = make_nearest(robot, path, turn)
    piece, at, off, knot = _known_positions(nearest, bounds, trajectory) or _search_positions(
        nearest, bounds, trajectory
    )
    most = path.joint_bounds()
    if most is not None and robot.linkage is not None:
        most = most[..., robot.linkage.joint] * np.abs(robot.linkage.factor)
    errors = _Errors(bounds, path, nearest, np.minimum(enough, ERROR_FLOOR), most)
    proved = errors.bound(piece, at, off) + ERROR_ROUNDING
    error = PathError(*(float(x) for x in (*proved, *errors.found, *errors.when)))
    t, s = (np.append(x[: piece.size], x[2 * piece.size - 1]) for x in (at.t, at.s))
    return error, Passage(t, s, knot, np.concatenate(errors.falls))


Intervals = tuple[Indices, ComparedInstants, Array, Flags]
"""The pieces (k,) of intervals; the one-sided instants at which they begin, then those at which they end; the distances and
angles (2 k, 2) there; and flags (k + 1,) of boundaries that are knots of the motion."""


def _known_positions(nearest: Nearest, bounds: MotionBounds, trajectory: Trajectory) -> Intervals | None:
    """Return the pieces of the motion at the positions of its time law; None if those are unknown or of another path."""
    s = trajectory.s
    if s is None:
        return None
    at, off = _compare_ends(nearest, bounds.ends, s, trajectory)
    return None if off.max() > CHORD_ROOM else (np.arange(s.size - 1), at, off, np.ones(s.size, np.bool_))


def _search_positions(nearest: Nearest, bounds: MotionBounds, trajectory: Trajectory) -> Intervals:
    """Return the intervals of a motion whose positions along the path are found by a search."""
    piece, ends, knot = _first_intervals(nearest, bounds)
    return piece, *_compare_ends(nearest, ends, nearest.guess(_between(ends)), trajectory), knot


def _between(ends: Instants) -> Instants:
    """Return the k + 1 right-hand instants between intervals that begin, and then end, at the given ones."""
    count = ends.t.size // 2
    return Instants(*(np.concatenate([x[:count], x[-1:]]) for x in ends))


SAME_SIDES = 1e-9
"""Step of a position [rad, m] or of a velocity up to which both sides of a knot are compared with the path at one position."""


def _compare_ends(
    nearest: Nearest, ends: Instants, guess: Array, trajectory: Trajectory
) -> tuple[ComparedInstants, Array]:
    """Return what `_compare` does for the instants at which intervals begin and end, from guesses (k + 1,) between them."""
    left = np.arange(guess.size - 1)
    both = np.concatenate([left, left + 1])
    if any(np.abs(trajectory.jumps(order)).max(initial=0.0) > SAME_SIDES for order in (0, 1)):
        return _compare(ends, nearest.places(ends, guess[both]), nearest.asked)
    along = PathPositions(*(x[both] for x in nearest.places(_between(ends), guess)))
    return _compare(ends, along, nearest.asked)


def _compare(side: Instants, along: PathPositions, asked: Asked) -> tuple[ComparedInstants, Array]:
    """Return a motion compared with positions along its path, and the distances and angles (k, 2) to them."""
    error, off = np.empty((side.t.size, 3, 12)), np.empty((side.t.size, 2))
    compare(side.poses, side.motion, along.poses, along.twist, error, off)
    if asked != "pose":
        error[:, :, 3:], off[:, 1] = 0.0, 0.0
    if asked == "axis":
        # √2 times the difference of the axes z: its norm is that of E − I for a turn by the same angle
        z, path_z = side.poses[:, :3, 2], along.poses[:, :3, 2]
        rates = z - path_z, np.cross(side.motion[:, 0, 3:], z), -np.cross(along.twist[:, 3:], path_z)
        error[:, :, 3:6] = np.sqrt(2.0) * np.stack(rates, axis=1)
        off[:, 1] = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(rates[0], axis=1), 1.0))
    return ComparedInstants(side.t, side.joints, along.s, along.speed, along.path_joints, error), off


class _Errors:
    """Proved bounds on distance and angle between tool and path, and the backward stretches of the motion.

    ``found`` and ``when`` (2,) are the largest values found, and their times [s].
    """

    def __init__(self, bounds: MotionBounds, path: Path, nearest: Nearest, floor: Array, most: Array | None) -> None:
        self._bounds, self._nearest, self._floor = bounds, nearest, floor
        self._end, self._limits, self._joint_bounds = path.end, PieceBounds.of(path), most
        self.found, self.when = np.zeros(2), np.zeros(2)
        self.falls: list[Array] = []

    def bound(self, piece: Indices, at: ComparedInstants, off: Array) -> Array:
        """Return the bounds on both values, by dividing intervals until the bounds are close enough.

        The first half of the instants `at` begins the intervals, and the second half ends them.
        """
        left = np.arange(piece.size)
        right, proved, count = left + piece.size, np.zeros(2), 0
        shortest = NARROWEST_SHARE * float(self._bounds.knots[-1])
        self._keep_largest(at.t, off)
        while True:
            between, fall = self._between(at, left, right)
            over = (between / (ERROR_EXCESS * np.maximum(self.found, self._floor))).max(axis=1)
            loose = (over > 1.0) & (at.t[right] - at.t[left] > shortest)
            # The remainder falls with the fourth power of the interval: intervals that would be too many are not begun.
            if float((over[loose] ** 0.25).sum()) > self._most_intervals - count:
                loose[:] = False
            np.maximum(proved, between[~loose].max(axis=0, initial=0.0), out=proved)
            self.falls.append(fall[~loose & (fall[:, 1] > fall[:, 3])])
            if not loose.any():
                return np.maximum(proved, self.found)
            piece, left, right = piece[loose], left[loose], right[loose]
            count += loose.size - piece.size
            # Errors of cubics fall with parts⁴.
            parts = np.clip(np.ceil(over[loose] ** 0.25), 2, MOST_PARTS).astype(np.int64)
            total = int(parts.sum())
            inner, new = np.empty((2, total - parts.size)), np.empty((2, total), np.int64)
            divide(at, (left, right), parts, inner, new)
            t, guess = inner
            side = self._bounds.at(np.repeat(piece, parts - 1), t)
            middle, off = _compare(side, self._nearest.places(side, guess), self._nearest.asked)
            self._keep_largest(t, off)
            at = ComparedInstants(*(np.concatenate(pair) for pair in zip(at, middle, strict=True)))
            piece, (left, right) = np.repeat(piece, parts), new

    def _between(self, at: ComparedInstants, left: Indices, right: Indices) -> tuple[Array, Array]:
        """Return bounds (k, 2) on both values within intervals between instants, and the backward stretches (k, 4)."""
        out, fall = np.empty((left.size, 2)), np.empty((left.size, 4))
        arm, limits = (self._bounds.links, self._bounds.robot.prismatic), self._limits
        intervals(arm, limits, self._end, at, (left, right), out, fall)
        if self._nearest.asked == "point":
            out[:, 1] = 0.0
        if self._joint_bounds is not None:
            joint_intervals(arm, (limits.breaks, self._joint_bounds), self._end, at, (left, right), out)
        return out, fall

    @property
    def _most_intervals(self) -> int:
        """Largest number of intervals: few for a motion that is far off."""
        far = self.found.max() > NOT_ALONG_PATH or self._bounds.far_out_of_range
        return FEW_INTERVALS if far else ERROR_INTERVALS

    def _keep_largest(self, t: Array, off: Array) -> None:
        """Update the largest values found, and their times, with the values (k, 2) at instants."""
        for i, k in enumerate(off.argmax(axis=0)):
            if off[k, i] > self.found[i]:
                self.found[i], self.when[i] = off[k, i], t[k]


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
