"""Path error of a motion: a proved bound on distance and angle between tool and path, and the largest value found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik.base import Tolerance
from optik.types import Array, Flags, Indices
from planners.certificate import projection
from planners.certificate.bounds import (
    FEW_INTERVALS,
    NARROWEST_SHARE,
    Instants,
    MotionBounds,
    bezier_bound,
    joint_bounds,
    tool_bounds,
)
from planners.certificate.projection import Nearest, PathPositions
from planners.certificate.violation import Violation
from planners.paths.base import Asked, Path
from planners.trajectory import Trajectory

# ---------------- bounds on the distance and the angle between a tool and its path within intervals of time


JOINT_ROUNDING = 2e-15
"""Largest rounding error of a joint's difference from its path, as a fraction of the joint's position."""


Arm = tuple[Array, Flags]
"""Lengths (n + 1,) of the links [m], and which joints are prismatic (n,)."""
Ends = tuple[Indices, Indices]
"""Indices (k,) of the instants at which intervals begin, and of those at which they end."""


class ComparedInstants(NamedTuple):
    """A motion compared with its path at instants t (k,).

    ``joints`` (k, 6, n) are those of `Instants`. ``s`` (k,) are the path parameters of the tool, ``speed`` (k,) is ṡ, and
    ``path_joints`` are those of `planners.certificate.projection.PathPositions`. ``error`` (k, 3, 12) is that of `compare`.
    """

    t: Array
    joints: Array
    s: Array
    speed: Array
    path_joints: Array
    error: Array


@compiled
def _angle(norm: float) -> float:
    """Return the angle of a rotation E from ‖E − I‖ (Frobenius), which is 2√2 sin(angle / 2)."""
    return float(2.0 * np.arcsin(min(norm / (2.0 * np.sqrt(2.0)), 1.0)))


@compiled
def compare(poses: Array, twists: Array, path_poses: Array, twist: Array, error: Array, off: Array) -> None:
    """Compute the errors of tool poses from path poses, and their distances and angles.

    The position error and the rotation error E − I, with E = R_tool R_pathᵀ, are the first row of ``error``. The second row
    is its time derivative for a path at standstill, the third what each unit of ṡ adds to that.

    Shapes and units: poses, path_poses (k, 4, 4), twists (k, 3, 6), twist (k, 6), error (k, 3, 12), off (k, 2) [m, rad].
    """
    for k in range(poses.shape[0]):
        A, B, (value, rate, along) = poses[k], path_poses[k], (error[k, 0], error[k, 1], error[k, 2])
        w, p = twists[k, 0, 3:], twist[k, 3:]
        for i in range(3):
            value[i], rate[i], along[i] = A[i, 3] - B[i, 3], twists[k, 0, i], -twist[k, i]
            for j in range(3):
                value[3 + 3 * i + j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]
        E = value[3:].reshape(3, 3)
        for i in range(3):  # Ė = ω × E − E (ω_path ×)
            a, b = (i + 1) % 3, (i + 2) % 3
            for j in range(3):
                c, d = (j + 1) % 3, (j + 2) % 3
                rate[3 + 3 * i + j] = w[a] * E[b, j] - w[b] * E[a, j]
                along[3 + 3 * i + j] = E[i, d] * p[c] - E[i, c] * p[d]
        turned = 0.0
        for i in range(3):
            E[i, i] -= 1.0
            for j in range(3):
                turned += (A[i, j] - B[i, j]) ** 2
        off[k, 0] = np.sqrt(value[0] * value[0] + value[1] * value[1] + value[2] * value[2])
        off[k, 1] = _angle(np.sqrt(turned))


class PieceBounds(NamedTuple):
    """Bounds (m, 2, 4) on a path's derivatives, position and rotation, on the m pieces between its breaks (m + 1,)."""

    breaks: Array
    orders: Array

    @classmethod
    def of(cls, path: Path) -> PieceBounds:
        """Return the bounds on the derivatives of a path."""
        return cls(np.ascontiguousarray(path.breaks), path.known_bounds)


class CubicRates(NamedTuple):
    """Bounds on the derivatives of a cubic s(t) over an interval, and on its range."""

    speed: float
    acceleration: float
    jerk: float
    low: float
    high: float


@compiled
def _cubic_rates(s0: float, v0: float, s1: float, v1: float, h: float) -> CubicRates:
    """Return bounds on the derivatives and the range of the cubic with values s and slopes v at the ends of an interval h."""
    slope = (s1 - s0) / h
    a0, a1 = (6.0 * slope - 4.0 * v0 - 2.0 * v1) / h, (2.0 * v0 + 4.0 * v1 - 6.0 * slope) / h
    j = abs(a1 - a0) / h
    p, q = s0 + v0 * h / 3.0, s1 - v1 * h / 3.0  # Bézier points
    return CubicRates(
        max(abs(v0), abs(v1)) + j * h * h / 8.0, max(abs(a0), abs(a1)), j, min(s0, p, q, s1), max(s0, p, q, s1)
    )


@compiled
def _find_pieces(breaks: Array, low: float, high: float) -> tuple[int, int]:
    """Return the first and the last piece between breaks (m + 1,) that contain positions from low to high."""
    last = breaks.shape[0] - 2
    first = min(max(np.searchsorted(breaks, low) - 1, 0), last)
    return first, min(max(np.searchsorted(breaks, high, side="right") - 1, 0), last)


@compiled
def _fourth_rate(b2: float, b3: float, b4: float, rates: CubicRates) -> float:
    """Return a bound on the fourth time derivative of a path from bounds on its derivatives in s (Faà di Bruno)."""
    v, a = rates.speed, rates.acceleration
    return b2 * (4.0 * v * rates.jerk + 3.0 * a * a) + 6.0 * b3 * v * v * a + b4 * v**4


@compiled
def path_rates(
    bounds: PieceBounds, places: tuple[float, float], speeds: tuple[float, float], h: float, out: Array
) -> None:
    """Compute bounds on the time derivatives of a path's position and rotation for a cubic s(t) over h (Faà di Bruno).

    s(t) is given by its ends.

    Shapes and units: places, speeds (2,) [m, or rad], h [s], out (2, 5) [m/s^i].
    """
    rates = _cubic_rates(places[0], speeds[0], places[1], speeds[1], h)
    v, a = rates.speed, rates.acceleration
    first, final = _find_pieces(bounds.breaks, rates.low, rates.high)
    for part in range(2):
        b1, b2, b3, b4 = 0.0, 0.0, 0.0, 0.0
        for i in range(first, final + 1):
            b1, b2 = max(b1, bounds.orders[i, part, 0]), max(b2, bounds.orders[i, part, 1])
            b3, b4 = max(b3, bounds.orders[i, part, 2]), max(b4, bounds.orders[i, part, 3])
        out[part, 0] = 1.0
        out[part, 1] = b1 * v
        out[part, 2] = b1 * a + b2 * v * v
        out[part, 3] = b1 * rates.jerk + 3.0 * b2 * v * a + b3 * v**3
        out[part, 4] = _fourth_rate(b2, b3, b4, rates)


@compiled
def _clip_speed(v: float, before: float, after: float, h: float) -> float:
    """Return a rate of s, clipped so that the Bézier points of its cubic stay on the path (lengths before and after)."""
    return min(max(v, -3.0 * before / h), 3.0 * after / h)


@compiled
def intervals(
    arm: Arm, bounds: PieceBounds, end: float, at: ComparedInstants, ends: Ends, out: Array, fall: Array
) -> None:
    """Compute bounds on distance and angle within intervals between instants of `at`; s(t) is the cubic through their ends.

    Shapes and units: end [m, or rad], ends (2,) of (k,), out (k, 2) [m, rad], fall (k, 4) [s; m, or rad].
    """
    (links, prismatic), (left, right) = arm, ends
    D, work, moves, turns = np.empty(at.joints.shape[1:]), np.empty((2, 6)), np.empty(6), np.empty(6)
    b, r0, r1 = np.empty((2, 5)), np.empty(12), np.empty(12)
    for k in range(left.shape[0]):
        i, j = left[k], right[k]
        h, s0, s1 = at.t[j] - at.t[i], at.s[i], at.s[j]
        joint_bounds(at.joints[i], h, D)
        tool_bounds(links, prismatic, D, work, moves, turns)
        v0 = _clip_speed(at.speed[i], s0, end - s0, h)
        v1 = _clip_speed(at.speed[j], end - s1, s1, h)
        e0, e1 = at.error[i, 0], at.error[j, 0]
        for m in range(12):
            r0[m] = at.error[i, 1, m] + v0 * at.error[i, 2, m]
            r1[m] = at.error[j, 1, m] + v1 * at.error[j, 2, m]
        path_rates(bounds, (s0, s1), (v0, v1), h, b)
        fall[k] = _fall(s0, v0 * h, s1, v1 * h)
        fall[k, ::2] = at.t[i] + fall[k, ::2] * h
        fourth = moves[4] + b[0, 4]
        out[k, 0] = bezier_bound(e0[:3], r0[:3], e1[:3], r1[:3], h, fourth)
        fourth = product_bound(turns, b[1])
        out[k, 1] = _angle(bezier_bound(e0[3:], r0[3:], e1[3:], r1[3:], h, fourth))


@compiled
def joint_intervals(
    arm: Arm, bounds: tuple[Array, Array], end: float, at: ComparedInstants, ends: Ends, out: Array
) -> None:
    """Lower bounds on distance and angle within intervals to those that follow from the errors of the joints, if less.

    A joint that differs by e moves the tool by at most e times its greatest distance from the axis, and turns it by e. Where
    tool and path turn fast together, this bound needs far longer intervals than that of `intervals`.

    Shapes and units: breaks (m + 1,) and bounds (m, 4, n) [rad/s^i, m/s^i], end [m, or rad], ends (2,) of (k,), out
    (k, 2) [m, rad].
    """
    (links, prismatic), (left, right) = arm, ends
    n = prismatic.shape[0]
    D, e = np.empty(at.joints.shape[1:]), np.empty(n)
    breaks, orders = bounds
    for k in range(left.shape[0]):
        a0, a1 = left[k], right[k]
        h, s0, s1 = at.t[a1] - at.t[a0], at.s[a0], at.s[a1]
        joint_bounds(at.joints[a0], h, D)
        v0 = _clip_speed(at.speed[a0], s0, end - s0, h)
        v1 = _clip_speed(at.speed[a1], end - s1, s1, h)
        rates = _cubic_rates(s0, v0, s1, v1, h)
        first, final = _find_pieces(breaks, rates.low, rates.high)
        third = h / 3.0
        for j in range(n):
            path = 0.0
            for m in range(first, final + 1):
                path = max(path, _fourth_rate(orders[m, 1, j], orders[m, 2, j], orders[m, 3, j], rates))
            e0 = at.joints[a0, 0, j] - at.path_joints[a0, 0, j]
            e1 = at.joints[a1, 0, j] - at.path_joints[a1, 0, j]
            a = e0 + third * (at.joints[a0, 1, j] - v0 * at.path_joints[a0, 1, j])
            b = e1 - third * (at.joints[a1, 1, j] - v1 * at.path_joints[a1, 1, j])
            e[j] = max(abs(e0), abs(e1), abs(a), abs(b)) + (D[4, j] + path) * h**4 / 384.0
            e[j] += JOINT_ROUNDING * D[0, j]
        reach, distance, angle = links[n], 0.0, 0.0
        for j in range(n - 1, -1, -1):
            if prismatic[j]:
                distance += e[j]
                reach += D[0, j] + e[j]
            else:
                distance += reach * e[j]
                angle += e[j]
            reach += links[j]
        out[k, 0], out[k, 1] = min(out[k, 0], distance), min(out[k, 1], angle)


@compiled
def product_bound(a: Array, b: Array) -> float:
    """Return a bound on the Frobenius norm of the fourth derivative of R_tool R_pathᵀ.

    Shapes and units: a, b (5,) [1/s^i]. Returns [1/s⁴].
    """
    fourth = a[0] * b[4] + 4.0 * a[1] * b[3] + 6.0 * a[2] * b[2] + 4.0 * a[3] * b[1] + a[4] * b[0]
    return float(np.sqrt(3.0) * fourth)  # of a 3×3 matrix


@compiled
def _fall(s0: float, v0: float, s1: float, v1: float) -> tuple[float, float, float, float]:
    """Return begin and end of the longest backward stretch of the cubic with these values and slopes at 0 and 1.

    Each is an argument of the cubic and its value there; they are equal if there is no such stretch.
    """
    c3, c2 = 2.0 * (s0 - s1) + v0 + v1, 3.0 * (s1 - s0) - 2.0 * v0 - v1
    root = c2 * c2 - 3.0 * c3 * v0
    turns = (0.0, 1.0)  # turning points in order: the roots of 3 c₃ u² + 2 c₂ u + v₀
    if root > 0.0 and c2 + np.copysign(np.sqrt(root), c2) != 0.0:
        w = -(c2 + np.copysign(np.sqrt(root), c2))
        a, b = v0 / w, (w / (3.0 * c3) if c3 != 0.0 else 2.0)
        turns = (min(a, b), max(a, b))
    peak, top = 0.0, s0
    begin, high, end, low = 0.0, s0, 0.0, s0
    for u in (turns[0], turns[1], 1.0):
        if not 0.0 < u <= 1.0:
            continue
        s = s1 if u == 1.0 else s0 + u * (v0 + u * (c2 + u * c3))
        if s > top:
            peak, top = u, s
        if top - s > high - low:
            begin, high, end, low = peak, top, u, s
    return begin, high, end, low


@compiled
def divide(at: ComparedInstants, ends: Ends, parts: Indices, inner: Array, new: Indices) -> None:
    """Divide intervals between instants of `at` into equal parts: their inner instants, with s on the cubics through the ends.

    Shapes and units: ends (2,) of (k,), parts (k,), inner (2, Σ (parts − 1)) [s; m, or rad], new (2, Σ parts): the instants at
    which the parts begin and end, of `at` followed by the inner ones.
    """
    a, b = 0, 0
    left, right = ends
    for k in range(left.shape[0]):
        i, j = left[k], right[k]
        t0, s0, s1 = at.t[i], at.s[i], at.s[j]
        h = at.t[j] - t0
        for part in range(parts[k]):
            new[0, b], new[1, b] = at.t.shape[0] + a - 1 if part else i, at.t.shape[0] + a
            b += 1
            if part + 1 == parts[k]:
                new[1, b - 1] = j
                break
            u = (part + 1) / parts[k]
            w = 1.0 - u
            before = w * w * ((1.0 + 2.0 * u) * s0 + u * h * at.speed[i])
            inner[0, a] = t0 + u * h
            inner[1, a] = before + u * u * ((1.0 + 2.0 * w) * s1 - w * h * at.speed[j])
            a += 1


# ---------------- path error of a motion


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
    turn: float = projection.NEAREST_TURN,
) -> tuple[PathError, Passage]:
    """Return bounds on the distance and the angle between the tool and its path over a motion, and its passage along the path.

    The tool is compared with the path at s(t), which is that of the time law, or else the projection of the whole motion onto
    the path (`planners.certificate.projection`). Between instants the error is bounded by its cubic interpolant and the fourth
    derivatives of both motions (`planners.certificate.bounds`); the bound holds for any s(t). Intervals are divided until it is
    at most 1.05 times the largest value found, or 1 nm (1 nrad).
    """
    bounds = bounds or MotionBounds(robot, trajectory)
    nearest = projection.make_nearest(robot, path, turn)
    piece, at, off, knot = _known_positions(nearest, bounds, trajectory) or _search_positions(
        nearest, bounds, trajectory
    )
    most = path.joint_bounds()
    if most is not None and robot.linkage is not None:
        most = most[..., robot.linkage.joint] * np.abs(robot.linkage.factor)
    errors = PathErrors(bounds, PieceBounds.of(path), path.end, nearest, np.minimum(enough, ERROR_FLOOR), most)
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
    return None if off.max() > projection.CHORD_ROOM else (np.arange(s.size - 1), at, off, np.ones(s.size, np.bool_))


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
    """Compare a motion with its path where intervals begin and end, from guesses (k + 1,) between them."""
    left = np.arange(guess.size - 1)
    both = np.concatenate([left, left + 1])
    if any(np.abs(trajectory.jumps(order)).max(initial=0.0) > SAME_SIDES for order in (0, 1)):
        return compare_with_path(ends, nearest.places(ends, guess[both]), nearest.asked)
    along = PathPositions(*(x[both] for x in nearest.places(_between(ends), guess)))
    return compare_with_path(ends, along, nearest.asked)


def compare_with_path(side: Instants, along: PathPositions, asked: Asked) -> tuple[ComparedInstants, Array]:
    """Return a motion compared with positions along its path, and the distances and angles (k, 2) to them."""
    error, off = np.empty((side.t.size, 3, 12)), np.empty((side.t.size, 2))
    compare(side.poses, side.twists, along.poses, along.twist, error, off)
    if asked != "pose":
        error[:, :, 3:], off[:, 1] = 0.0, 0.0
    if asked == "axis":
        # √2 times the difference of the axes z: its norm is that of E − I for a turn by the same angle
        z, path_z = side.poses[:, :3, 2], along.poses[:, :3, 2]
        rates = z - path_z, np.cross(side.twists[:, 0, 3:], z), -np.cross(along.twist[:, 3:], path_z)
        error[:, :, 3:6] = np.sqrt(2.0) * np.stack(rates, axis=1)
        off[:, 1] = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(rates[0], axis=1), 1.0))
    return ComparedInstants(side.t, side.joints, along.s, along.speed, along.path_joints, error), off


class PathErrors:
    """Proved bounds on distance and angle between tool and path, and the backward stretches of the motion.

    ``found`` and ``when`` (2,) are the largest values found, and their times [s].
    """

    def __init__(
        self, bounds: MotionBounds, path: PieceBounds, end: float, nearest: Nearest, floor: Array, most: Array | None
    ) -> None:
        self._bounds, self._nearest, self._floor = bounds, nearest, floor
        self._end, self._path_bounds, self._joint_bounds = end, path, most
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
            middle, off = compare_with_path(side, self._nearest.places(side, guess), self._nearest.asked)
            self._keep_largest(t, off)
            at = ComparedInstants(*(np.concatenate(pair) for pair in zip(at, middle, strict=True)))
            piece, (left, right) = np.repeat(piece, parts), new

    def _between(self, at: ComparedInstants, left: Indices, right: Indices) -> tuple[Array, Array]:
        """Return bounds (k, 2) on both values within intervals between instants, and the backward stretches (k, 4)."""
        out, fall = np.empty((left.size, 2)), np.empty((left.size, 4))
        arm, bounds = (self._bounds.links, self._bounds.robot.prismatic), self._path_bounds
        intervals(arm, bounds, self._end, at, (left, right), out, fall)
        if self._nearest.asked == "point":
            out[:, 1] = 0.0
        if self._joint_bounds is not None:
            joint_intervals(arm, (bounds.breaks, self._joint_bounds), self._end, at, (left, right), out)
        return out, fall

    @property
    def _most_intervals(self) -> int:
        """Largest number of intervals: few for a motion that is far off."""
        far = self.found.max() > projection.NOT_ALONG_PATH or self._bounds.far_out_of_range
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
    return np.asarray(np.clip(np.ceil(np.sqrt(bend / projection.BEND)), 1, LOOK_PARTS), np.int64)
