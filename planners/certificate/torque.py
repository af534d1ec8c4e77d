"""Greatest torques and torque rates of every joint along a trajectory: proved upper bounds.

Coulomb friction in the torque is f sign(q̇) where the sign of the velocity is proved constant on an interval, and the whole set
[−f, f] where a joint rests or reverses: in an interval with a change of sign, and at instants of rest. The torque rate excludes
Coulomb friction, which jumps there.

Bounds on torques and their rates within intervals of time: values at both ends, and a bound on the fourth derivative.

Inside a piece the torque τ of a joint is smooth. At both ends of an interval of length h it and its rate are known exactly. For
the cubic H through these four numbers,

    |τ − H| ≤ h⁴ / 384 · max|τ⁗|        and        |τ̇ − Ḣ| ≤ √3 h³ / 216 · max|τ⁗|

(Birkhoff and Priver, Hermite interpolation errors for derivatives, J. Math. Phys. 46, 1967; both constants are sharp), and the
extrema of a cubic and of its parabola are exact.

The fourth derivative. By d'Alembert's principle the torque of joint i is the sum over the masses dm that it carries, at x,

    τ_i = Σ ∫ ∂x/∂q_i · (ẍ − g) dm + motor_i q̈_i + viscous_i q̇_i.

In link l, x = c_l + ρ with the centre of mass c_l and ρ fixed in the link; terms of one factor ρ integrate to zero. So

    τ_i = Σ_l  m_l ∂c_l/∂q_i · (c̈_l − g)  +  ∫ (z_i × ρ) · ρ̈ dm      (the second part for a revolute joint i only).

A vector of length 1 that is fixed in link l is turned by the joints 1 to l: its kth derivative is at most B_k(S_1 to S_k),
the complete Bell polynomial of S_i = Σ |dⁱq_j/dtⁱ| over the revolute ones of them; see `planners.certificate.bounds`. So
|c_l⁽ᵏ⁾| is at most Σ_j |d_j| B_k(S of joints before j) + |c| B_k(S of joint l), with d_j the fixed vector before joint j; one
that slides adds z_j q_j, by Leibniz's rule. For a revolute joint i, ∂c_l/∂q_i = z_i × (c_l − p_i), where z_i turns with joints
before i and each part of c_l − p_i with these and further ones: a product of rotations, whose derivatives have the bounds of
that part alone. So has z_i × ρ, and ∫ |ρ|² dm is half of the trace of the inertia about the centre of mass. Leibniz's rule
gives the bound on τ⁗. As q⁽⁶⁾ = 0 in quintics, the motors' inertia adds nothing to it, and viscous friction |q⁽⁵⁾|.
Of gravity alone, −Σ m_l ∂c_l/∂q_i · g, only the fourth derivative of ∂c_l/∂q_i remains.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np

from optik.arm.inertia import Inertia, Load
from optik.arm.linkage import Linkage
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.dynamics import torques_batch
from optik.kinematics import Chain
from optik.types import Array, Flags
from planners.certificate.bounds import joint_bounds, link_bounds
from planners.limits.inputs import TorqueRatios
from planners.trajectory.curve import BINOMIAL

VALUE_REMAINDER = 1.0 / 384.0
"""Largest distance of a function from its cubic Hermite interpolant, over h⁴ and its fourth derivative."""
RATE_REMAINDER = float(np.sqrt(3.0)) / 216.0
"""Largest distance of a function's derivative from that of its cubic Hermite interpolant, over h³ and its fourth derivative."""
Sizes = tuple[Array, Flags, Array, Array, Array, Array, float]
"""Sizes of an arm and its load: lengths of the fixed vectors before the joints (n,) [m], prismatic joints (n,), masses (n,)
[kg], distances of the centres of mass from the joints' origins (n,) [m], halves of the traces of the inertias (n,) [kg·m²],
viscous friction (n,) [N·m·s/rad, N·s/m], and the size of gravity [m/s²]."""


def sizes(robot: Robot, load: Load) -> Sizes:
    """Return the sizes of an arm and its load."""
    mass, com, tensor, _motor, gravity = load.bodies
    lengths = np.linalg.norm(robot.fixed[:, :3, 3], axis=1)
    half = 0.5 * np.trace(tensor, axis1=1, axis2=2)
    viscous = load.viscous if robot.linkage is None else cast(Inertia, robot.inertia).viscous
    return (
        lengths, np.asarray(robot.axes.prismatic), mass, np.linalg.norm(com, axis=1), half, viscous,
        float(np.linalg.norm(gravity)),
    )  # fmt: skip


@compiled
def fourth_bounds(arm: Sizes, D: Array, still: bool, work: Array, out: Array) -> None:
    """Compute bounds on |τ⁗| of every joint within an interval.

    Shapes and units: D (6, n) [rad/s^i, m/s^i], work (2, n + 1, 7) [1], out (n,) [N·m/s⁴, N/s⁴].
    """
    lengths, prismatic, mass, com, half, viscous, gravity = arm
    n = mass.shape[0]
    B, P, motion = work[0], work[1], 0.0 if still else 1.0
    link_bounds(lengths, prismatic, D, B, P)
    for i in range(n):
        out[i] = motion * viscous[i] * D[5, i]
    A, V = np.empty(5), np.empty(5)
    for link in range(n):
        b, p = B[link + 1], P[link + 1]
        spin = 0.0
        for m in range(5):
            A[m] = motion * mass[link] * (p[m + 2] + com[link] * b[m + 2])
            spin += motion * BINOMIAL[4, m] * b[m] * b[6 - m]
        A[0] += mass[link] * gravity
        for i in range(link + 1):
            for m in range(5):
                V[m] = B[i, m] if prismatic[i] else p[m] - P[i + 1, m] + com[link] * b[m]
            total = 0.0 if prismatic[i] else half[link] * spin
            for m in range(5):
                total += BINOMIAL[4, m] * V[m] * A[4 - m]
            out[i] += total


def fourth_bounds_of(robot: Robot, load: Load, D: Array) -> Array:
    """Return bounds (k, n) on the fourth derivatives of the torques of a load from those of the joints (k, 6, n)."""
    out = np.empty((len(D), robot.n))
    _fourths_of(sizes(robot, load), D, out)
    return out


@compiled
def _fourths_of(arm: Sizes, D: Array, out: Array) -> None:
    space = np.empty((2, D.shape[2] + 1, 7))
    for k in range(D.shape[0]):
        fourth_bounds(arm, D[k], False, space, out[k])


@compiled
def cubic_range(a: float, b: float, c: float, d: float, h: float) -> tuple[float, float]:
    """Return the least and the greatest value on [0, h] of the cubic with given values and rates at both ends.

    Shapes and units: a, b [as the cubic], c, d [as the cubic, over s], h [s]. Returns [as the cubic].
    """
    low, high = min(a, b), max(a, b)
    one, two = a + h * c / 3.0, b - h * d / 3.0  # inner Bézier points: the cubic is within the hull of all four
    if low <= min(one, two) and max(one, two) <= high:
        return low, high
    p = h * c  # of x in [0, 1]: a + p x + q x² + r x³
    q, r = 3.0 * (b - a) - h * (2.0 * c + d), 2.0 * (a - b) + h * (c + d)
    root = q * q - 3.0 * p * r
    if root < 0.0:
        return low, high
    s = -(q + np.copysign(np.sqrt(root), q))
    for x in (s / (3.0 * r) if r != 0.0 else -1.0, p / s if s != 0.0 else -1.0):
        if 0.0 < x < 1.0:
            y = a + x * (p + x * (q + x * r))
            low, high = min(low, y), max(high, y)
    return low, high


@compiled
def slope_range(a: float, b: float, c: float, d: float, h: float) -> tuple[float, float]:
    """Return the least and the greatest rate on [0, h] of the cubic of `cubic_range`.

    Shapes and units: a, b [as the cubic], c, d [as the cubic, over s], h [s]. Returns [as the cubic, over s].
    """
    low, high = min(c, d), max(c, d)
    q, r = 3.0 * (b - a) / h - 2.0 * c - d, 2.0 * (a - b) / h + c + d  # of x in [0, 1]: c + 2 q x + 3 r x²
    if r != 0.0:
        x = -q / (3.0 * r)
        if 0.0 < x < 1.0:
            y = c + x * (2.0 * q + 3.0 * r * x)
            low, high = min(low, y), max(high, y)
    return low, high


@compiled
def direction(rates: Array, h: float) -> int:
    """Return the proved sign of a joint's velocity in an interval, from its Bernstein coefficients; 0 if it may change.

    Shapes and units: rates (5,) [rad/s^i, m/s^i], h [s].
    """
    factor, b = 1.0, np.zeros(5)
    for k in range(5):
        for j in range(k, 5):
            b[j] += BINOMIAL[j, k] / BINOMIAL[4, k] * rates[k] * factor
        factor *= h / (k + 1)
    least, most = b.min(), b.max()
    if least >= 0.0 and most > 0.0:
        return 1
    return -1 if most <= 0.0 and least < 0.0 else 0


TORQUE_EXCESS = 1e-5
"""Largest excess of the bound over the largest value found, as a fraction of it."""
TORQUE_FLOOR = 1e-2
"""Least fraction of a limit that the excess is relative to."""
TORQUE_INTERVALS = 200_000
"""Largest number of intervals: a second of computing; a motion that needs more has a looser bound."""
NARROWEST = 1e-9
"""Fraction of a motion's duration below which an interval is not divided: rounding in t is near."""
STANDSTILL = 1e-9
"""Fraction of the largest velocity of all joints below which a joint is at rest: it is rounding error of the polynomials."""


class TorqueEnds(NamedTuple):
    """A motion at the first and at the last instant of every piece.

    Attributes
    ----------
    t0, t1 : (m,) array
        Times [s].
    first, last : (m, 6, n) array
        The joints' derivatives [rad/s^i, m/s^i].
    fourths : (m, n) array
        Bounds on the fourth derivatives of the torques within the pieces [N·m/s⁴, N/s⁴].
    left, right : (m, 2, n) array
        Torques and their rates, without Coulomb friction [N·m, N, N·m/s, N/s].
    """

    t0: Array
    t1: Array
    first: Array
    last: Array
    left: Array
    right: Array
    fourths: Array


ALL, GRAVITY, MOTION = 0, 1, 2
"""Parts of the torque: all without Coulomb friction, that of gravity, or that which accelerates the masses."""
Model = tuple[Chain, Load, Sizes, int, Linkage | None]
"""An arm, its load, the sizes of both, the part of the torque, and the relations of its axes."""


class TorqueBounds:
    """A motion with its torques; the torques at the ends of its pieces are cached."""

    def __init__(self, robot: Robot, knots: Array, first: Array, last: Array, *, still: bool = False) -> None:
        self.models: tuple[Model, ...] = tuple(
            (robot.chain, load, sizes(robot, load), GRAVITY if still else ALL, robot.linkage) for load in robot.loads
        )
        self.ends: list[TorqueEnds] = []
        for model in self.models:
            left, right = (np.empty((len(first), 2, robot.n)) for _ in range(2))
            evaluate_torques(model, first, left)
            evaluate_torques(model, last, right)
            fourths = np.empty(first[:, 0].shape)
            bound_fourths(model, np.diff(knots), first, fourths)
            self.ends.append(TorqueEnds(knots[:-1], knots[1:], first, last, left, right, fourths))
        self._kept: dict[tuple[bool, bytes], TorqueRatios] = {}

    def bound_ratios(
        self, bound: Array, *, rate: bool, excess: float = TORQUE_EXCESS, most: int = TORQUE_INTERVALS
    ) -> TorqueRatios:
        """Return bounds on the ratios of the torques, or of their rates, to their limits; results are cached."""
        key = (rate, np.array([*np.ravel(bound), excess, most]).tobytes())
        if key not in self._kept:
            each = [
                _bound_load(model, ends, bound, (rate, excess, most))
                for model, ends in zip(self.models, self.ends, strict=True)
            ]
            self._kept[key] = each[0] if len(each) == 1 else _select_worse(*each)
        return self._kept[key]

    def piece_ratios(self, bound: Array, *, rate: bool) -> Array:
        """Return the ratios of joint torques, or of their rates, to the limits: on each piece the larger end value."""
        lower, upper = bound
        worst = np.zeros((len(self.ends[0].t0), upper.size))
        for model, ends in zip(self.models, self.ends, strict=True):
            for joints, values in ((ends.first, ends.left), (ends.last, ends.right)):
                value = values[:, 1] if rate else values[:, 0] + model[1].coulomb * np.sign(joints[:, 1])
                worst = np.maximum(worst, np.where(value < 0.0, value / lower, value / upper))
        return np.asarray(worst)


def _select_worse(a: TorqueRatios, b: TorqueRatios) -> TorqueRatios:
    """Return, joint by joint, the larger torque ratios of two loads."""
    first = a.ratio >= b.ratio
    return TorqueRatios(*(np.where(first, x, y) for x, y in zip(a, b, strict=True)))


def _bound_load(model: Model, ends: TorqueEnds, bound: Array, how: tuple[bool, float, int]) -> TorqueRatios:
    """Return bounds on the torque ratios of one load; `how` is (for the rates, relative excess, greatest interval count)."""
    rate, excess, most = how
    lower, upper = bound
    limits = np.stack([-lower, upper])
    limits = np.where(np.isfinite(limits), limits, 1.0)
    n = upper.size
    rest = rest_velocity(ends)
    coulomb = np.zeros(n) if rate else np.array(model[1].coulomb)
    results = np.zeros((2, n)), np.zeros((2, n)), np.zeros((2, n))
    close = (1.0 + excess, TORQUE_FLOOR, NARROWEST * float(ends.t1[-1]))
    _divide(model, ends, (coulomb, 1.0 / limits, rate, rest), most, close, results)
    proved, found, when = results
    above = proved[1] >= proved[0]
    ratio, largest, time = (np.where(above, x[1], x[0]) for x in (proved, found, when))
    return TorqueRatios(ratio, largest, time, above)


def rest_velocity(ends: TorqueEnds) -> float:
    """Return the velocity below which a joint is at rest."""
    return STANDSTILL * max(float(np.abs(ends.first[:, 1]).max()), float(np.abs(ends.last[:, 1]).max()))


def evaluate_torques(model: Model, joints: Array, out: Array) -> None:
    """Compute torques and their rates, without Coulomb friction."""
    chain, load, _, part, _ = model
    states = np.ascontiguousarray(joints[:, :4])
    torques_batch(chain, load.bodies, load.viscous if part == ALL else _nothing(load.viscous), states, out)
    if part == ALL:
        return
    kinetic = np.empty_like(out)
    torques_batch(chain, (*load.bodies[:4], _nothing(load.bodies[4])), _nothing(load.viscous), states, kinetic)
    out[:] = kinetic if part == MOTION else out - kinetic


def _nothing(like: Array) -> Array:
    """Return zeros like an array, read-only if it is, so that kernels are compiled once."""
    zeros = np.zeros_like(like)
    zeros.setflags(write=like.flags.writeable)
    return zeros


def at_middle(model: Model, ends: TorqueEnds) -> tuple[Array, Array]:
    """Return the joints' derivatives and the torques in the middle of every piece."""
    joints, values = np.empty_like(ends.first), np.empty_like(ends.left)
    _advance(ends.first, 0.5 * (ends.t1 - ends.t0), joints)
    evaluate_torques(model, joints, values)
    return joints, values


@compiled
def _advance(joints: Array, t: Array, out: Array) -> None:
    """Compute the derivatives of quintics (k, 6, n) after times t (k,), from those at instants."""
    for k in range(joints.shape[0]):
        for i in range(joints.shape[2]):
            for order in range(6):
                value = joints[k, 5, i]
                for m in range(4, order - 1, -1):
                    value = joints[k, m, i] + value * t[k] / (m + 1 - order)
                out[k, order, i] = value


RatioTerms = tuple[Array, Array, bool, float]
"""Terms of the ratios: Coulomb friction (n,), weights (2, n) of the lower and the upper side, which are 1 over the absolute
limits, whether for the rates, and the velocity of a joint at rest."""


def _divide(
    model: Model, ends: TorqueEnds, what: RatioTerms, most: int, close: tuple[float, float, float],
    results: tuple[Array, Array, Array],
) -> None:  # fmt: skip
    """Bound the ratios of torques to limits over all pieces, into results: proved, found and their times (2, n).

    Intervals are halved until their bounds are close to the largest values found, or they are too short or too many.

    close: the factor, the floor and the shortest interval.
    """
    t, h, joints, left, right = ends.t0, ends.t1 - ends.t0, ends.first, ends.left, ends.right
    proved, found, when = results
    fourths = ends.fourths
    _update_largest(t, joints, left, what, found, when)
    _update_largest(ends.t1, ends.last, right, what, found, when)
    while True:
        bound = np.empty((t.size, 2, found.shape[1]))
        _between(what, h, joints, fourths, (left, right), bound)
        loose = _find_loose(bound, h, found, close, most, proved)
        if not loose.any():
            break
        t, h, joints, left, right = t[loose], 0.5 * h[loose], joints[loose], left[loose], right[loose]
        most -= t.size
        later, middle = np.empty_like(joints), np.empty_like(left)
        _advance(joints, h, later)
        evaluate_torques(model, later, middle)
        _update_largest(t + h, later, middle, what, found, when)
        t, h, joints = np.concatenate([t, t + h]), np.concatenate([h, h]), np.concatenate([joints, later])
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
        fourths = np.empty(joints[:, 0].shape)
        bound_fourths(model, h, joints, fourths)
    np.maximum(proved, found, out=proved)


@compiled
def _update_largest(t: Array, joints: Array, values: Array, what: RatioTerms, found: Array, when: Array) -> None:
    """Update the largest ratios (2, n) and their times with those at instants."""
    coulomb, weights, rate, rest = what
    for k in range(t.shape[0]):
        for i in range(coulomb.shape[0]):
            value, velocity = values[k, int(rate), i], joints[k, 1, i]
            still = abs(velocity) <= rest
            f = coulomb[i] * np.sign(velocity)
            low = -weights[0, i] * (value - coulomb[i] if still else value + f)
            high = weights[1, i] * (value + (coulomb[i] if still else f))
            if low > found[0, i]:
                found[0, i], when[0, i] = low, t[k]
            if high > found[1, i]:
                found[1, i], when[1, i] = high, t[k]


@compiled
def _find_loose(
    bound: Array, h: Array, found: Array, close: tuple[float, float, float], room: int, proved: Array
) -> Flags:
    """Return the intervals (k,) to divide, whose bounds (k, 2, n) are not close enough; update `proved` with the others.

    Returns (k,).
    """
    factor, floor, narrowest = close
    loose = np.zeros(h.shape[0], np.bool_)
    n = found.shape[1]
    for k in range(h.shape[0]):
        for i in range(n):
            target = factor * max(found[0, i], found[1, i], floor)
            loose[k] |= h[k] > narrowest and max(bound[k, 0, i], bound[k, 1, i]) > target
    full = loose.sum() > room
    for k in range(h.shape[0]):
        loose[k] = loose[k] and not full
        if not loose[k]:
            for i in range(n):
                proved[0, i], proved[1, i] = max(proved[0, i], bound[k, 0, i]), max(proved[1, i], bound[k, 1, i])
    return loose


def bound_fourths(model: Model, h: Array, joints: Array, out: Array) -> None:
    """Write what `_fourths` computes; of a linkage with the derivatives of the axes, whose torques move the joints."""
    _, _, arm, part, follow = model
    if follow is None:
        _fourths(arm, part == GRAVITY, h, joints, out)
        return
    axes = joints[..., follow.joint] * follow.factor
    axes[:, 0] += follow.offset
    each = np.empty(axes[:, 0].shape)
    _fourths(arm, part == GRAVITY, h, axes, each)
    out[:] = each @ np.abs(follow.matrix)


@compiled
def _fourths(arm: Sizes, still: bool, h: Array, joints: Array, out: Array) -> None:
    """Compute bounds (k, n) on the torques' fourth derivatives in intervals, from joint derivatives (k, 6, n) at the starts."""
    D, space = np.empty(joints.shape[1:]), np.empty((2, joints.shape[2] + 1, 7))
    for k in range(h.shape[0]):
        joint_bounds(joints[k], h[k], D)
        fourth_bounds(arm, D, still, space, out[k])


@compiled
def _between(
    what: RatioTerms, h: Array, joints: Array, fourths: Array, values: tuple[Array, Array], bound: Array
) -> None:
    """Compute bounds (k, 2, n) on the ratios of torques to both limits in intervals, from the joints' derivatives (k, 6, n).

    fourths: bounds (k, n) on the fourth derivatives; values: torques and rates (k, 2, n) at the starts and at the ends.
    """
    coulomb, weights, rate, _ = what
    left, right = values
    for k in range(h.shape[0]):
        for i in range(coulomb.shape[0]):
            a, c, b, d = left[k, 0, i], left[k, 1, i], right[k, 0, i], right[k, 1, i]
            if rate:
                low, high = slope_range(a, b, c, d, h[k])
                off = RATE_REMAINDER * h[k] ** 3 * fourths[k, i]
            else:
                low, high = cubic_range(a, b, c, d, h[k])
                off = VALUE_REMAINDER * h[k] ** 4 * fourths[k, i]
            low, high = low - off, high + off
            f = coulomb[i]
            if f > 0.0:
                sense = direction(joints[k, 1:, i], h[k])  # 0: both signs
                low, high = low + (sense * f if sense != 0 else -f), high + (sense * f if sense != 0 else f)
            bound[k, 0, i], bound[k, 1, i] = -weights[0, i] * low, weights[1, i] * high
