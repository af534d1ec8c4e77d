"""Path error of a motion: a proved bound on the deviation of the tool at every instant, and the largest value found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik.base import Tolerance
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import (
    Closeness,
    Instants,
    MotionBounds,
    SubdivisionBound,
    bezier_bound,
    join_ends,
    joint_bounds,
    repeat_ends,
    tool_bounds,
)
from planners.certificate.projection import BEND, Nearest, NearestJoints, positions_along
from planners.certificate.violation import Violation
from planners.paths.base import Path
from planners.trajectory import Trajectory


class ComparedInstants(NamedTuple):
    """Tool and path at instants t (k,).

    ``joints`` (k, 6, n), ``poses`` (k, 4, 4) and ``motion`` (k, 3, 6) are those of `Instants`. ``s`` (k,) are the
    path parameters of the tool, ``speed`` (k,) is ṡ, ``path_poses`` (k, 4, 4) and ``twist`` (k, 6) are those of the path.
    """

    t: Array
    joints: Array
    poses: Array
    motion: Array
    s: Array
    speed: Array
    path_poses: Array
    twist: Array


@compiled
def _turn(A: Array, B: Array, out: Array) -> None:
    """Compute E = R_tool R_pathᵀ of two poses, into out (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]


@compiled
def _angle(norm: float) -> float:
    """Return the angle of a rotation E from ‖E − I‖ (Frobenius), which is 2√2 sin(angle / 2)."""
    return float(2.0 * np.arcsin(min(norm / (2.0 * np.sqrt(2.0)), 1.0)))


@compiled
def _error(tool: Array, motion: Array, pose: Array, twist: Array, speed: float, value: Array, rate: Array) -> None:
    """Compute the tool's position error and rotation error E − I (12,) from its path pose, and their time derivatives."""
    E = np.empty((3, 3))
    _turn(tool, pose, E)
    for i in range(3):
        value[i] = tool[i, 3] - pose[i, 3]
        rate[i] = motion[0, i] - speed * twist[i]
    w = (motion[0, 3], motion[0, 4], motion[0, 5])
    p = (speed * twist[3], speed * twist[4], speed * twist[5])
    for i in range(3):  # Ė = ω × E − E (ω_path ×)
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            value[3 + 3 * i + j] = E[i, j] - (1.0 if i == j else 0.0)
            rate[3 + 3 * i + j] = w[a] * E[b, j] - w[b] * E[a, j] - (E[i, c] * p[d] - E[i, d] * p[c])


class PieceBounds(NamedTuple):
    """Bounds (m, 2, 4) on a path's derivatives, position and rotation, on the m pieces between its breaks (m + 1,)."""

    breaks: Array
    bounds: Array

    @classmethod
    def of(cls, path: Path) -> PieceBounds:
        """Return the bounds on the derivatives of a path."""
        return cls(np.ascontiguousarray(path.breaks), path.known_bounds)


@compiled
def _bounds_on_stretch(limits: PieceBounds, low: float, high: float, out: Array) -> None:
    """Compute the largest bounds (2, 4) on the path's derivatives over all pieces between two positions."""
    last = limits.bounds.shape[0] - 1
    first = min(max(np.searchsorted(limits.breaks, low) - 1, 0), last)
    final = min(max(np.searchsorted(limits.breaks, high, side="right") - 1, 0), last)
    for part in range(2):
        for k in range(4):
            out[part, k] = 0.0
            for i in range(first, final + 1):
                out[part, k] = max(out[part, k], limits.bounds[i, part, k])


@compiled
def path_rates(
    limits: PieceBounds, places: tuple[float, float], speeds: tuple[float, float], h: float, out: Array
) -> None:
    """Compute bounds on the time derivatives of a path's position and rotation for a cubic s(t) over h (Faà di Bruno).

    s(t) is given by its ends; its Bézier points bound its range.

    Shapes and units: places, speeds (2,) [m, or rad], h [s], out (2, 5) [m/s^i].
    """
    (s0, s1), (v0, v1) = places, speeds
    slope = (s1 - s0) / h
    a0, a1 = (6.0 * slope - 4.0 * v0 - 2.0 * v1) / h, (2.0 * v0 + 4.0 * v1 - 6.0 * slope) / h
    j = abs(a1 - a0) / h
    v = max(abs(v0), abs(v1)) + j * h * h / 8.0
    a = max(abs(a0), abs(a1))
    b = np.empty((2, 4))
    p, q = s0 + v0 * h / 3.0, s1 - v1 * h / 3.0
    _bounds_on_stretch(limits, min(s0, p, q, s1), max(s0, p, q, s1), b)
    for part in range(2):
        b1, b2, b3, b4 = b[part, 0], b[part, 1], b[part, 2], b[part, 3]
        out[part, 0] = 1.0
        out[part, 1] = b1 * v
        out[part, 2] = b1 * a + b2 * v * v
        out[part, 3] = b1 * j + 3.0 * b2 * v * a + b3 * v**3
        out[part, 4] = b2 * (4.0 * v * j + 3.0 * a * a) + 6.0 * b3 * v * v * a + b4 * v**4


@compiled
def _clip_speed(v: float, before: float, after: float, h: float) -> float:
    """Return a rate of s, clipped so that the Bézier points of its cubic stay on the path (lengths before and after)."""
    return min(max(v, -3.0 * before / h), 3.0 * after / h)


@compiled
def intervals(
    links: Array,
    prismatic: Flags,
    limits: PieceBounds,
    end: float,
    left: ComparedInstants,
    right: ComparedInstants,
    out: Array,
    fall: Array,
) -> None:
    """Compute bounds on distance and angle within intervals of time; s(t) is the cubic through their ends.

    Shapes and units: links (n + 1,) [m], prismatic (n,), end [m, or rad], out (k, 2) [m, rad], fall (k, 2) [m, or rad].
    """
    k = left.t.shape[0]
    h = right.t - left.t
    D, moves, turns, spin = np.empty(left.joints.shape), np.empty((k, 6)), np.empty((k, 6)), np.empty(k)
    joint_bounds(left.joints, h, D)
    tool_bounds(links, prismatic, D, moves, turns, spin)
    e0, r0, e1, r1, b = np.empty(12), np.empty(12), np.empty(12), np.empty(12), np.empty((2, 5))
    for i in range(k):
        v0 = _clip_speed(left.speed[i], left.s[i], end - left.s[i], h[i])
        v1 = _clip_speed(right.speed[i], end - right.s[i], right.s[i], h[i])
        _error(left.poses[i], left.motion[i], left.path_poses[i], left.twist[i], v0, e0, r0)
        _error(right.poses[i], right.motion[i], right.path_poses[i], right.twist[i], v1, e1, r1)
        path_rates(limits, (left.s[i], right.s[i]), (v0, v1), h[i], b)
        fall[i, 0], fall[i, 1] = _fall(left.s[i], v0 * h[i], right.s[i], v1 * h[i])
        fourth = moves[i, 4] + b[0, 4]
        out[i, 0] = bezier_bound(e0[:3], r0[:3], e1[:3], r1[:3], h[i], fourth)
        fourth = product_bound(turns[i], b[1])
        out[i, 1] = _angle(bezier_bound(e0[3:], r0[3:], e1[3:], r1[3:], h[i], fourth))


@compiled
def product_bound(a: Array, b: Array) -> float:
    """Return a bound on the Frobenius norm of the fourth derivative of R_tool R_pathᵀ.

    Shapes and units: a, b (5,) [1/s^i]. Returns [1/s⁴].
    """
    fourth = a[0] * b[4] + 4.0 * a[1] * b[3] + 6.0 * a[2] * b[2] + 4.0 * a[3] * b[1] + a[4] * b[0]
    return float(np.sqrt(3.0) * fourth)  # of a 3×3 matrix


@compiled
def _fall(s0: float, v0: float, s1: float, v1: float) -> tuple[float, float]:
    """Return the ends of the longest backward stretch of the cubic with these values and slopes at 0 and 1; equal if none."""
    c3, c2 = 2.0 * (s0 - s1) + v0 + v1, 3.0 * (s1 - s0) - 2.0 * v0 - v1
    root = c2 * c2 - 3.0 * c3 * v0
    turns = (0.0, 1.0)  # turning points in order: the roots of 3 c₃ u² + 2 c₂ u + v₀
    if root > 0.0 and c2 + np.copysign(np.sqrt(root), c2) != 0.0:
        w = -(c2 + np.copysign(np.sqrt(root), c2))
        a, b = v0 / w, (w / (3.0 * c3) if c3 != 0.0 else 2.0)
        turns = (min(a, b), max(a, b))
    top = high = low = s0
    for u in (turns[0], turns[1], 1.0):
        if not 0.0 < u <= 1.0:
            continue
        s = s1 if u == 1.0 else s0 + u * (v0 + u * (c2 + u * c3))
        top = max(top, s)
        if top - s > high - low:
            high, low = top, s
    return high, low


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

    ``falls`` (m, 3) are stretches on which s(t) decreases between two instants: the time, and s before and after.
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
) -> tuple[PathError, Passage]:
    """Return bounds on the distance and the angle between the tool and its path over a motion, and its passage along the path.

    The tool is compared with the path at s(t), the projection of the whole motion onto the path
    (`planners.certificate.projection`). Between instants the error is bounded by its cubic interpolant and the fourth
    derivatives of both motions (`planners.certificate.bounds`); the bound holds for any s(t). Intervals are divided until it is
    at most 1.05 times the largest value found, or 1 nm (1 nrad).
    """
    bounds = bounds or MotionBounds(robot, trajectory)
    nearest = NearestJoints(robot, path) if path.in_joints else Nearest(path)
    piece, left, right, knot = _first_intervals(bounds)
    if isinstance(nearest, NearestJoints):
        guess = nearest.guess(np.concatenate([left.joints[:, 0], right.joints[-1:, 0]]))
    else:
        guess = positions_along(path, np.concatenate([left.poses, right.poses[-1:]]), BEND)
    # One search for both ends.
    both = _compare(nearest, join_ends(left, right), np.concatenate([guess[:-1], guess[1:]]))
    first, last = (
        ComparedInstants(*(x[half] for x in both)) for half in (slice(None, piece.size), slice(piece.size, None))
    )
    errors = _Errors(bounds, path, nearest, trajectory.end, np.minimum(enough, ERROR_FLOOR))
    proved = errors.bound(piece, first, last) + ERROR_ROUNDING
    error = PathError(*(float(x) for x in (*proved, *errors.found, *errors.when)))
    t, s = np.append(first.t, last.t[-1]), np.append(first.s, last.s[-1])
    return error, Passage(t, s, knot, np.concatenate(errors.falls))


def _compare(nearest: Nearest | NearestJoints, side: Instants, guess: Array) -> ComparedInstants:
    """Return the tool at instants, and the nearest positions along the path from a guess."""
    return ComparedInstants(*side, *nearest.places(side, guess))


class _Errors(SubdivisionBound[ComparedInstants]):
    """Distance and angle between tool and path, and the backward stretches of the motion."""

    def __init__(
        self, bounds: MotionBounds, path: Path, nearest: Nearest | NearestJoints, duration: float, floor: Array
    ) -> None:
        super().__init__(duration, Closeness(ERROR_EXCESS, floor, ERROR_INTERVALS))
        self._bounds, self._nearest, self._end, self._limits = bounds, nearest, path.end, PieceBounds.of(path)
        self._fall = np.empty((0, 2))
        self.falls: list[Array] = []

    def between(self, left: ComparedInstants, right: ComparedInstants) -> Array:
        out, self._fall = np.empty((2, left.t.size, 2))
        intervals(
            self._bounds.links, self._bounds.robot.prismatic, self._limits, self._end, left, right, out, self._fall
        )
        return out

    def within(
        self, piece: Indices, left: ComparedInstants, right: ComparedInstants, shares: Array
    ) -> ComparedInstants:
        t, guess = _interpolate(shares, shares.size // piece.size, left, right)
        return _compare(self._nearest, self._bounds.at(repeat_ends(piece, shares.size // piece.size), t), guess)

    def values(self, side: ComparedInstants) -> Array:
        apart = (side.poses - side.path_poses).reshape(-1, 16)
        values = np.sqrt((apart * apart) @ DISTANCE_AND_TURN)
        values[:, 1] = 2.0 * np.arcsin(np.minimum(values[:, 1] / np.sqrt(8.0), 1.0))
        return np.asarray(values)

    def record_closed(self, which: Flags, left: ComparedInstants) -> None:
        back = which & (self._fall[:, 0] > self._fall[:, 1])
        self.falls.append(np.column_stack([left.t[back], self._fall[back]]))


def _first_intervals(bounds: MotionBounds) -> tuple[Indices, Instants, Instants, Flags]:
    """Return intervals in which the tool is within about `BEND` of a straight line: their pieces and their one-sided ends.

    Also return which of the k + 1 instants between them are knots of the motion.
    """
    t = bounds.knots
    piece = np.arange(t.size - 1)
    left, right = bounds.ends
    parts = _count_parts(left, right)
    if parts.max() == 1:
        return piece, left, right, np.ones(t.size, np.bool_)
    which = np.repeat(piece, parts)
    part = np.arange(which.size) - np.repeat(np.cumsum(parts) - parts, parts)
    begin = t[which] + part * (np.diff(t) / parts)[which]
    end = np.where(part + 1 == parts[which], t[which + 1], np.append(begin[1:], t[-1]))
    return which, bounds.at(which, begin), bounds.at(which, end), np.append(part == 0, True)


def _count_parts(left: Instants, right: Instants) -> Indices:
    """Return the numbers (k,) of equal parts in which the tool is within `BEND` of a straight line, by |a| h²/8."""
    way = right.poses[:, :3, 3] - left.poses[:, :3, 3]
    size = (way * way) @ np.ones(3)
    a = np.stack([left.motion[:, 1, :3], right.motion[:, 1, :3]])
    # Acceleration along the line does not bend it.
    along = ((a * way) @ np.ones(3)) ** 2 / np.where(size > 0.0, size, 1.0)
    bend = np.sqrt(np.maximum((a * a) @ np.ones(3) - along, 0.0).max(axis=0)) * (right.t - left.t) ** 2 / 8.0
    return np.asarray(np.clip(np.ceil(np.sqrt(bend / BEND)), 1, LOOK_PARTS), np.int64)


def _interpolate(u: Array, times: int, left: ComparedInstants, right: ComparedInstants) -> tuple[Array, Array]:
    """Return instants at fractions u of intervals, repeated `times` times, and s on the cubics through their ends."""
    t0, h = repeat_ends(left.t, times), repeat_ends(right.t - left.t, times)
    s0, v0, s1, v1 = (repeat_ends(x, times) for x in (left.s, left.speed, right.s, right.speed))
    w = 1.0 - u
    s = w * w * ((1.0 + 2.0 * u) * s0 + u * h * v0) + u * u * ((1.0 + 2.0 * w) * s1 - w * h * v1)
    return t0 + u * h, s
