"""Proved bounds on derivatives and tool speeds from the joints' polynomials, and proved peaks over a motion.

The tool is at p = Σ_l R_l f_l, the sum over the arm's links of fixed vectors rotated by all joints before them. If the joints
before link l have Σ |q̇| ≤ S₁, Σ |q̈| ≤ S₂ and so on, then |dᵏR_l/dtᵏ| ≤ B_k(S₁, …, S_k), the complete Bell polynomial. For one
joint this is Faà di Bruno's formula; for products of rotations the S are added, because Bell polynomials are of binomial type.
A prismatic joint adds R_j z q_j, by Leibniz's rule.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.kinematics import Chain
from optik.types import Array, Flags, Indices
from planners.limits.inputs import Enclose, Evaluate
from planners.trajectory import Trajectory, map_joints
from planners.trajectory.curve import BINOMIAL, bell

# ---------------- proved bounds on the derivatives and on the speeds of a tool's motion


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
def link_bounds(lengths: Array, prismatic: Flags, D: Array, B: Array, P: Array) -> None:
    """Compute bounds on the derivatives of links 0 to n over an interval: of their rotations, and of their joints' origins.

    Shapes and units: lengths (n,) [m] to each joint from the one before, prismatic (n,), D (6, n) [rad/s^i, m/s^i],
    B (n + 1, 7) [1/s^i], P (n + 1, 7) [m/s^i].
    """
    S = np.zeros(7)
    B[0, :], P[0, :] = 0.0, 0.0
    B[0, 0] = 1.0
    for i in range(prismatic.shape[0]):
        for k in range(7):
            P[i + 1, k] = P[i, k] + lengths[i] * B[i, k]
        if prismatic[i]:
            for k in range(7):
                B[i + 1, k] = B[i, k]
                for m in range(max(0, k - 5), k + 1):
                    P[i + 1, k] += BINOMIAL[k, m] * B[i, m] * D[k - m, i]
        else:
            for k in range(1, 6):
                S[k] += D[k, i]
            bell(S, B[i + 1])


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
def instant(c: Array, piece: int, u: float, out: Array) -> None:
    """Compute the derivatives of order 0 to 5 of a quintic piece at u [s]: c (6, m, n), out (6, n) [rad/s^i, m/s^i]."""
    for j in range(c.shape[2]):
        for order in range(6):
            value = 0.0
            for power in range(5, order - 1, -1):
                factor = 1.0
                for i in range(order):
                    factor *= power - i
                value = value * u + factor * c[5 - power, piece, j]
            out[order, j] = value


@compiled
def instants(c: Array, piece: Indices, u: Array, out: Array) -> None:
    """Compute the derivatives (k, 6, n) of the joints at u (k,) after the beginnings of pieces (k,)."""
    for k in range(u.shape[0]):
        instant(c, piece[k], u[k], out[k])


@compiled
def _move(chain: Chain, joints: Array, poses: Array, twists: Array) -> None:
    """Write the tool's poses (k, 4, 4), and its twist with two derivatives (k, 3, 6), from the joints' (k, 6, n)."""
    frame, T, _J = kinematics.workspace(chain, joints.shape[2])
    for k in range(joints.shape[0]):
        kinematics.forward(chain, joints[k, 0], frame, T)
        poses[k] = T
        kinematics.tool_motion(chain, frame, T, joints[k, 0], joints[k, 1:4], twists[k])


class Instants(NamedTuple):
    """A motion at instants t (k,).

    ``joints`` (k, 6, n) are the derivatives of q of order 0 to 5, ``poses`` (k, 4, 4) the tool poses, ``twists`` (k, 3, 6)
    the tool's twist and its first two derivatives in the base frame.
    """

    t: Array
    joints: Array
    poses: Array
    twists: Array


FAR_OUT, FEW_INTERVALS = 2.0 * np.pi, 5_000
"""Largest distance outside a joint's limits [rad, m] at which bounds are computed closely, and the largest number of intervals
of a motion that is farther out or off its path."""


def axes_motion(robot: Robot, trajectory: Trajectory) -> Trajectory:
    """Return the motion of the axes of an arm's chain, which are its joints but for a linkage."""
    follow = robot.linkage
    return trajectory if follow is None else map_joints(trajectory, follow.matrix, follow.offset)


class MotionBounds:
    """A trajectory cut into intervals, each with bounds on the derivatives of the tool's motion; joints are the axes."""

    def __init__(self, robot: Robot, trajectory: Trajectory) -> None:
        self.robot, self._trajectory = robot.axes, axes_motion(robot, trajectory)
        self._c = self._trajectory.padded
        self.knots: Array = trajectory.knots.copy()  # writable like other times, so that kernels are compiled once
        self.lengths: Array = np.linalg.norm(robot.fixed[:, :3, 3], axis=1)
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
        poses, twists = np.empty((t.size, 4, 4)), np.empty((t.size, 3, 6))
        _move(self.robot.chain, joints, poses, twists)
        return Instants(t, joints, poses, twists)

    def bound_speeds(self, piece: Indices, at: Instants, limits: Array) -> Array:
        """Return bounds on |v| and |ω| over their limits (k, 2), the largest ratios found, and their times (3, 2).

        Between instants v and ω are bounded by their cubic interpolants and fourth derivatives. Intervals are divided until the
        bounds exceed the largest values found by at most 1e-6 of them.

        The first half of the instants `at` begins intervals of the motion, and the second half ends them.
        """
        out = np.zeros((3, 2))
        most = FEW_INTERVALS if self.far_out_of_range else SPEED_INTERVALS
        arm = (self.robot.chain, self.links)
        _bound_speeds(arm, (self._c, self.knots), piece, at, limits, most, out)
        return out


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


NARROWEST_SHARE = 1e-9
"""Fraction of a motion's duration below which an interval is not divided: rounding in t is near."""
SPEED_EXCESS = 1e-6
"""Largest excess of the bound over the largest speed found, as a fraction of it."""
SPEED_FLOOR = 1e-6
"""Least speed [m/s or rad/s] that the excess is relative to."""
SPEED_INTERVALS = 200_000
"""Largest number of intervals: minutes of computing; a motion that needs more has a looser bound."""
SPEED_HALVINGS = 32
"""Largest number of times that an interval is halved: 2⁻³² is below `NARROWEST_SHARE`."""


@compiled
def _ratio(twist: Array, limits: Array, part: int) -> float:
    """Return |v| or |ω| of a twist in the first row of `twist`, over its limit."""
    x, y, z = twist[0, 3 * part], twist[0, 3 * part + 1], twist[0, 3 * part + 2]
    return float(np.sqrt(x * x + y * y + z * z) / limits[part])


@compiled
def _bound_speeds(
    arm: tuple[Chain, Array],
    curve: tuple[Array, Array],
    piece: Indices,
    at: Instants,
    limits: Array,
    most: int,
    out: Array,
) -> None:
    """Write what `MotionBounds.bound_speeds` returns; an interval is halved until its bound is close to the largest found.

    Shapes and units: curve coefficients (6, m, n) and knots (m + 1,), piece (k,), limits (k, 2), out (3, 2) [1, 1, s].
    """
    (chain, links), (c, knots) = arm, curve
    n, k, count = c.shape[2], piece.shape[0], 0
    frame, T, _J = kinematics.workspace(chain, n)
    D, work, moves, turns = np.empty((6, n)), np.empty((2, 6)), np.empty(6), np.empty(6)
    # An instant that begins an interval, and the ends of that interval and of those after it, the nearest last.
    left_joints, left_twist = np.empty((6, n)), np.empty((3, 6))
    t, joints = np.empty(SPEED_HALVINGS + 1), np.empty((SPEED_HALVINGS + 1, 6, n))
    twists = np.empty((SPEED_HALVINGS + 1, 3, 6))
    proved, largest, when = out[0], out[1], out[2]
    for i in range(2 * k):
        for part in range(2):
            ratio = _ratio(at.twists[i], limits[i % k], part)
            if ratio > largest[part]:
                largest[part], when[part] = ratio, at.t[i]
    for i in range(k):
        left, left_joints[:], left_twist[:] = at.t[i], at.joints[i], at.twists[i]
        t[0], joints[0], twists[0] = at.t[i + k], at.joints[i + k], at.twists[i + k]
        top = 0
        while top >= 0:
            h = t[top] - left
            joint_bounds(left_joints, h, D)
            spin = tool_bounds(links, chain[1], D, work, moves, turns)
            a, b = left_twist, twists[top]
            v = bezier_bound(a[0, :3], a[1, :3], b[0, :3], b[1, :3], h, moves[5]) / limits[i, 0]
            w = bezier_bound(a[0, 3:], a[1, 3:], b[0, 3:], b[1, 3:], h, spin) / limits[i, 1]
            over = max(v / max(largest[0], SPEED_FLOOR), w / max(largest[1], SPEED_FLOOR)) / (1.0 + SPEED_EXCESS)
            # The remainder falls with the fourth power of the interval: intervals that would be too many are not begun.
            if over > 1.0 and h > NARROWEST_SHARE * knots[-1] and top < SPEED_HALVINGS and over**0.25 <= most - count:
                top += 1
                t[top] = left + 0.5 * h
                instant(c, piece[i], t[top] - knots[piece[i]], joints[top])
                kinematics.forward(chain, joints[top, 0], frame, T)
                kinematics.tool_motion(chain, frame, T, joints[top, 0], joints[top, 1:4], twists[top])
                for part in range(2):
                    ratio = _ratio(twists[top], limits[i], part)
                    if ratio > largest[part]:
                        largest[part], when[part] = ratio, t[top]
                continue
            proved[0], proved[1], count = max(proved[0], v), max(proved[1], w), count + 1
            left, left_joints[:], left_twist[:] = t[top], joints[top], twists[top]
            top -= 1
    proved[0], proved[1] = max(proved[0], largest[0]), max(proved[1], largest[1])


# ---------------- proved bound on the peak of a value over a motion


DIVIDED, DIVISIONS = 4, 40
"""Parts of a divided interval, and the largest number of divisions."""
PEAK_INTERVALS = 200_000
"""Largest number of bounded intervals; the bound on what is left is then not close."""


def prove_peak(bounds: MotionBounds, evaluate: Evaluate, enclose: Enclose, excess: float) -> tuple[float, float]:
    """Return a proved upper bound on peak / limit, at most a fraction `excess` above the largest found, and its time [s].

    A ratio that is nowhere found above 1 is bounded until it is proved to be at most 1: a part of a valid motion is valid.
    """
    piece, (left, right) = np.arange(bounds.knots.size - 1), bounds.joint_ends
    begin, end = bounds.knots[:-1].copy(), bounds.knots[1:].copy()
    first, last = evaluate(left), evaluate(right)
    peak, when, proved, intervals = -np.inf, 0.0, -np.inf, 0
    for _ in range(DIVISIONS):
        for at, values in ((begin, first), (end, last)):
            k = int(values[:, 0].argmax())
            when = float(at[k]) if values[k, 0] > peak else when
            peak = float(np.maximum(peak, values[k, 0]))
        h = end - begin
        B, P = np.empty((2, h.size, bounds.robot.n + 1, 7))
        _link_bounds(bounds.lengths, np.asarray(bounds.robot.prismatic), left, h, B, P)
        bound = enclose(first, last, h, B, P)
        intervals += h.size
        close = min(peak * (1.0 + excess), 1.0) if peak <= 1.0 else peak * (1.0 + excess)
        wide = (bound > close) & (h > NARROWEST_SHARE * bounds.knots[-1])
        if intervals > PEAK_INTERVALS:
            wide[:] = False
        proved = float(np.maximum(proved, bound[~wide].max(initial=-np.inf)))
        if not wide.any():
            break
        piece, h = np.repeat(piece[wide], DIVIDED), h[wide]
        cuts = begin[wide, None] + h[:, None] * np.arange(DIVIDED + 1) / DIVIDED
        cuts[:, -1] = end[wide]
        inner = bounds.joints_at(piece.reshape(-1, DIVIDED)[:, 1:].ravel(), cuts[:, 1:-1].ravel())
        values = evaluate(inner).reshape(h.size, DIVIDED - 1, -1)
        left = np.concatenate([left[wide][:, None], inner.reshape(h.size, DIVIDED - 1, *left.shape[1:])], axis=1)
        left = left.reshape(-1, *left.shape[2:])
        ends = np.concatenate([first[wide][:, None], values, last[wide][:, None]], axis=1)
        first, last = (np.ascontiguousarray(x.reshape(-1, x.shape[2])) for x in (ends[:, :-1], ends[:, 1:]))
        begin, end = cuts[:, :-1].ravel(), cuts[:, 1:].ravel()
    return float(np.maximum(proved, peak)), when


@compiled
def _link_bounds(lengths: Array, prismatic: Flags, joints: Array, h: Array, B: Array, P: Array) -> None:
    """Write the bounds of `link_bounds` over [0, h] from the derivatives (k, 6, n) at its beginning."""
    D = np.empty(joints.shape[1:])
    for k in range(h.shape[0]):
        joint_bounds(joints[k], h[k], D)
        link_bounds(lengths, prismatic, D, B[k], P[k])
