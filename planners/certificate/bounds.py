"""Proved bounds on the derivatives and on the speeds of a tool's motion, from the joints' polynomials.

The tool is at p = Σ_l R_l f_l, the sum over the arm's links of fixed vectors rotated by all joints before them. If the joints
before link l have Σ |q̇| ≤ S₁, Σ |q̈| ≤ S₂ and so on, then |dᵏR_l/dtᵏ| ≤ B_k(S₁, …, S_k), the complete Bell polynomial. For one
joint this is Faà di Bruno's formula; for products of rotations the S are added, because Bell polynomials are of binomial type.
A prismatic joint adds R_j z q_j, by Leibniz's rule.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.kinematics import Chain
from optik.types import Array, Flags, Indices
from planners.curve import BINOMIAL, bell
from planners.trajectory import Trajectory


@compiled
def tool_bounds(links: Array, prismatic: Flags, D: Array, work: Array, position: Array, rotation: Array) -> float:
    """Compute bounds on the derivatives of the tool's motion over an interval from those of the joints.

    Shapes and units: links (n + 1,) [m], prismatic (n,), D (6, n) [rad/s^i, m/s^i], work (2, 6), position (6,) [m/s^i],
    rotation (6,) [1/s^i]. Returns the bound on the fourth derivative of the angular velocity [rad/s⁵].
    """
    n = prismatic.shape[0]
    S, B = work[0], work[1]
    for i in range(6):
        S[i] = position[i] = 0.0
    spin = 0.0
    bell(S, B)
    for j in range(n):
        if prismatic[j]:
            for i in range(1, 6):
                for m in range(i + 1):
                    position[i] += BINOMIAL[i, m] * B[m] * D[i - m, j]
        else:
            for m in range(5):
                spin += BINOMIAL[4, m] * B[m] * D[5 - m, j]
            for i in range(1, 6):
                S[i] += D[i, j]
            bell(S, B)
        for i in range(1, 6):
            position[i] += links[j + 1] * B[i]
    for i in range(6):
        rotation[i] = B[i]
    return spin


@compiled
def joint_bounds(derivatives: Array, h: float, D: Array) -> None:
    """Compute bounds on the derivatives of quintics over [t, t + h]: the Taylor sums of those at t.

    Shapes and units: derivatives (6, n) [rad/s^i, m/s^i], h [s], D (6, n) [rad/s^i, m/s^i].
    """
    for i in range(6):
        for j in range(derivatives.shape[1]):
            total, factor = 0.0, 1.0
            for m in range(6 - i):
                total += abs(derivatives[i + m, j]) * factor
                factor *= h / (m + 1)
            D[i, j] = total


@compiled
def instants(c: Array, piece: Indices, u: Array, out: Array) -> None:
    """Compute derivatives of order 0 to 5 of quintic pieces at instants.

    Shapes and units: c (6, m, n) [rad/s^i, m/s^i], piece (k,), u (k,) [s], out (k, 6, n) [rad/s^i, m/s^i].
    """
    for k in range(u.shape[0]):
        for j in range(c.shape[2]):
            for order in range(6):
                value = 0.0
                for power in range(5, order - 1, -1):
                    factor = 1.0
                    for i in range(order):
                        factor *= power - i
                    value = value * u[k] + factor * c[5 - power, piece[k], j]
                out[k, order, j] = value


@compiled
def _move(chain: Chain, joints: Array, poses: Array, motion: Array) -> None:
    """Write the tool's poses (k, 4, 4), and its twist with two derivatives (k, 3, 6), from the joints' (k, 6, n)."""
    frame, T, _J = kinematics.workspace(joints.shape[2])
    for k in range(joints.shape[0]):
        kinematics.forward(chain, joints[k, 0], frame, T)
        poses[k] = T
        kinematics.tool_motion(chain, frame, T, joints[k, 0], joints[k, 1:4], motion[k])


class Instants(NamedTuple):
    """A motion at instants t (k,).

    ``joints`` (k, 6, n) are the derivatives of q of order 0 to 5, ``poses`` (k, 4, 4) the tool poses, ``motion`` (k, 3, 6)
    the tool's twist and its first two derivatives in the base frame.
    """

    t: Array
    joints: Array
    poses: Array
    motion: Array


FAR_OUT, FEW_INTERVALS = 2.0 * np.pi, 5_000
"""Largest distance outside a joint's limits [rad, m] at which bounds are computed closely, and the largest number of intervals
of a motion that is farther out or off its path."""


class MotionBounds:
    """A trajectory cut into intervals, each with bounds on the derivatives of the tool's motion."""

    def __init__(self, robot: Robot, trajectory: Trajectory) -> None:
        self.robot, self._trajectory = robot, trajectory
        self._c = trajectory.padded
        self.knots: Array = trajectory.knots.copy()  # writable like other times, so that kernels are compiled once
        self.links: Array = np.linalg.norm([*robot.fixed[:, :3, 3], robot.tool[:3, 3]], axis=1)

    @cached_property
    def far_out_of_range(self) -> bool:
        """Whether a joint is farther than `FAR_OUT` outside its limits: then no bound makes the motion valid."""
        reach, limits = self._trajectory.extrema(0), self.robot.limits
        return bool(max((limits.lower - reach.least).max(), (reach.greatest - limits.upper).max()) > FAR_OUT)

    @cached_property
    def joint_ends(self) -> tuple[Array, Array]:
        """Derivatives (m, 6, n) of the joints at the first and at the last instant of every piece [rad/s^i, m/s^i]."""
        piece = np.arange(self.knots.size - 1)
        return self.joints_at(piece, self.knots[:-1]), self.joints_at(piece, self.knots[1:])

    @cached_property
    def ends(self) -> Instants:
        """The motion at the first instants of all pieces, then at the last ones."""
        return self._moving(np.concatenate([self.knots[:-1], self.knots[1:]]), np.concatenate(self.joint_ends))

    def joints_at(self, piece: Indices, t: Array) -> Array:
        """Return the derivatives of the joints at instants of given pieces."""
        joints = np.empty((t.size, 6, self.robot.n))
        instants(self._c, piece, t - self.knots[piece], joints)
        return joints

    def at(self, piece: Indices, t: Array) -> Instants:
        """Return the motion at instants of given pieces."""
        return self._moving(t, self.joints_at(piece, t))

    def _moving(self, t: Array, joints: Array) -> Instants:
        """Return the motion at instants from the joints' derivatives (k, 6, n)."""
        poses, motion = np.empty((t.size, 4, 4)), np.empty((t.size, 3, 6))
        _move(self.robot.chain, joints, poses, motion)
        return Instants(t, joints, poses, motion)


@compiled
def bezier_bound(left: Array, left_rate: Array, right: Array, right_rate: Array, h: float, fourth: float) -> float:
    """Return a bound on the norm over [0, h] of a curve by its values and rates at both ends and its fourth derivative.

    The curve is within fourth · h⁴ / 384 of its cubic Hermite interpolant (de Boor, A Practical Guide to Splines, ch. IV;
    applied in every direction). The cubic is in the convex hull of its Bézier points.

    Shapes and units: left, left_rate, right, right_rate (d,) [as the curve], h [s].
    """
    third, p0, p1, p2, p3 = h / 3.0, 0.0, 0.0, 0.0, 0.0
    for i in range(left.shape[0]):
        a, b = left[i], right[i]
        c, d = a + third * left_rate[i], b - third * right_rate[i]
        p0, p1, p2, p3 = p0 + a * a, p1 + b * b, p2 + c * c, p3 + d * d
    return float(np.sqrt(max(p0, p1, p2, p3)) + fourth * h**4 / 384.0)


MOST_PARTS = 8
"""Largest number of parts into which an interval is divided at once."""
NARROWEST_SHARE = 1e-9
"""Fraction of a motion's duration below which an interval is not divided: rounding in t is near."""
Side = TypeVar("Side", bound=Any)
"""A NamedTuple of arrays (k, ...) that begins with the times ``t`` (k,): the motion at instants."""


class Closeness(NamedTuple):
    """Accuracy of a bound: at most `factor` times the largest value found, or times `floor` if that is larger.

    ``most`` is the largest number of intervals; a motion that needs more keeps a looser bound.
    """

    factor: float
    floor: Array
    most: int


def join_sides(first: Side, second: Side) -> Side:
    """Join two sets of instants."""
    both: Side = type(first)(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))
    return both


class SubdivisionBound(ABC, Generic[Side]):
    """Proved bounds on two values of a motion over time, such as distance and angle.

    A subclass bounds the values within intervals, and computes them at instants.

    Parameters
    ----------
    bounds : MotionBounds
        The motion.
    close : Closeness
        Required accuracy of the bounds.

    Attributes
    ----------
    found, when : (2,) array
        Largest values found, and their times [s].
    """

    def __init__(self, bounds: MotionBounds, close: Closeness) -> None:
        self._bounds, self._close = bounds, close
        self._shortest = NARROWEST_SHARE * float(bounds.knots[-1])
        self.found, self.when = np.zeros(2), np.zeros(2)

    @abstractmethod
    def between(self, at: Side, left: Indices, right: Indices) -> Array:
        """Return bounds on both values within intervals between instants of `at`."""

    @abstractmethod
    def within(self, at: Side, piece: Indices, left: Indices, right: Indices, shares: Array) -> Side:
        """Return the motion inside intervals, at fractions `shares` of their durations."""

    @abstractmethod
    def values(self, side: Side) -> Array:
        """Return both values at instants."""

    @property
    def most_intervals(self) -> int:
        """Largest number of intervals."""
        return FEW_INTERVALS if self._bounds.far_out_of_range else self._close.most

    def record_closed(self, which: Flags) -> None:
        """Record the intervals of the last `between` that are not divided further."""

    def bound(self, piece: Indices, at: Side) -> Array:
        """Return the bounds on both values, by subdividing intervals until the bounds are close enough.

        The first half of the instants `at` begins the intervals, and the second half ends them.
        """
        left = np.arange(piece.size)
        right, proved, count = left + piece.size, np.zeros(2), 0
        self._keep_largest(at)
        while True:
            between = self.between(at, left, right)
            over = (between / (self._close.factor * np.maximum(self.found, self._close.floor))).max(axis=1)
            loose = (over > 1.0) & (at.t[right] - at.t[left] > self._shortest)
            # The remainder falls with the fourth power of the interval: intervals that would be too many are not begun.
            loose &= float((over[loose] ** 0.25).sum()) <= self.most_intervals - count
            np.maximum(proved, between[~loose].max(axis=0, initial=0.0), out=proved)
            self.record_closed(~loose)
            if not loose.any():
                return np.maximum(proved, self.found)
            count += loose.size - int(np.count_nonzero(loose))
            some, begin, end, parts = piece[loose], left[loose], right[loose], _count_parts(over[loose])
            shares = np.arange(1, parts).repeat(some.size) / parts
            every = [np.concatenate([x] * (parts - 1)) for x in (some, begin, end)]
            middle = self.within(at, every[0], every[1], every[2], shares)
            self._keep_largest(middle)
            inner = np.arange(at.t.size, at.t.size + shares.size)
            piece, left, right = (
                np.concatenate([some] * parts),
                np.concatenate([begin, inner]),
                np.concatenate([inner, end]),
            )
            at = join_sides(at, middle)

    def _keep_largest(self, side: Side) -> None:
        """Update the largest values found, and their times, with the values at instants."""
        values = self.values(side)
        for i, k in enumerate(values.argmax(axis=0)):
            if values[k, i] > self.found[i]:
                self.found[i], self.when[i] = values[k, i], side.t[k]


def _count_parts(over: Array) -> int:
    """Return the number of parts for intervals from their bounds over the target: errors of cubics fall with parts⁴."""
    if over.max() <= 2.0**4:
        return 2
    return int(np.clip(np.ceil(np.median(over) ** 0.25), 2, MOST_PARTS))


SPEED_EXCESS = 1e-6
"""Largest excess of the bound over the largest speed found, as a fraction of it."""


SPEED_FLOOR = 1e-6
"""Least speed [m/s or rad/s] that the excess is relative to."""


SPEED_INTERVALS = 200_000
"""Largest number of intervals: minutes of computing; a motion that needs more has a looser bound."""


MOVES_AND_TURNS = np.repeat(np.eye(2), 3, axis=0)
"""Matrix from the squares of a twist (6,) to |v|² and |ω|²."""


class ToolSpeed(NamedTuple):
    """Proved bounds on |v| [m/s] and |ω| [rad/s] of the tool over a motion, and the times of the peaks [s]."""

    speed: float
    rotation: float
    t_speed: float
    t_rotation: float


def tool_speed(robot: Robot, trajectory: Trajectory, bounds: MotionBounds | None = None) -> ToolSpeed:
    """Return proved bounds on the tool's speeds over a motion.

    Between instants v and ω are bounded by their cubic interpolants and fourth derivatives (`planners.certificate.bounds`).
    Intervals are divided until the bounds exceed the largest values found by at most 1e-6 of them.
    """
    bounds = bounds or MotionBounds(robot, trajectory)
    speeds = _Speeds(bounds)
    proved = speeds.bound(np.arange(trajectory.knots.size - 1), bounds.ends)
    return ToolSpeed(float(proved[0]), float(proved[1]), float(speeds.when[0]), float(speeds.when[1]))


class _Speeds(SubdivisionBound[Instants]):
    """|v| and |ω| of the tool."""

    def __init__(self, bounds: MotionBounds) -> None:
        super().__init__(bounds, Closeness(1.0 + SPEED_EXCESS, np.full(2, SPEED_FLOOR), SPEED_INTERVALS))

    def between(self, at: Instants, left: Indices, right: Indices) -> Array:
        out = np.empty((left.size, 2))
        speeds_within(self._bounds.links, self._bounds.robot.prismatic, at, left, right, out)
        return out

    def within(self, at: Instants, piece: Indices, left: Indices, right: Indices, shares: Array) -> Instants:
        return self._bounds.at(piece, at.t[left] + shares * (at.t[right] - at.t[left]))

    def values(self, side: Instants) -> Array:
        twist = side.motion[:, 0]
        return np.asarray(np.sqrt((twist * twist) @ MOVES_AND_TURNS))


@compiled
def speeds_within(links: Array, prismatic: Flags, at: Instants, left: Indices, right: Indices, out: Array) -> None:
    """Compute bounds on |v| and |ω| of the tool within intervals between instants of `at`.

    Shapes and units: links (n + 1,) [m], prismatic (n,), left and right (k,), out (k, 2) [m/s, rad/s].
    """
    D, work, moves, turns = np.empty(at.joints.shape[1:]), np.empty((2, 6)), np.empty(6), np.empty(6)
    for k in range(left.shape[0]):
        i, j = left[k], right[k]
        h = at.t[j] - at.t[i]
        joint_bounds(at.joints[i], h, D)
        spin = tool_bounds(links, prismatic, D, work, moves, turns)
        a, b = at.motion[i], at.motion[j]
        out[k, 0] = bezier_bound(a[0, :3], a[1, :3], b[0, :3], b[1, :3], h, moves[5])
        out[k, 1] = bezier_bound(a[0, 3:], a[1, 3:], b[0, 3:], b[1, 3:], h, spin)
