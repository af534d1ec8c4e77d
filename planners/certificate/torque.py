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

Motors that move the axes together have the torques τ_m = T τ + I E q̈ + viscous E q̇, with T = Cᵀ and E = C⁻¹ of q = C m + c,
and the Coulomb friction of E q̇. So |τ_m⁗| ≤ |T| |τ⁗| + viscous |E q⁽⁵⁾|, and the rest of the proof is that of joints.
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
from planners.limits.inputs import Gears, TorqueRatios
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
    B, P, moving = work[0], work[1], 0.0 if still else 1.0
    link_bounds(lengths, prismatic, D, B, P)
    for i in range(n):
        out[i] = moving * viscous[i] * D[5, i]
    A, V = np.empty(5), np.empty(5)
    for link in range(n):
        b, p = B[link + 1], P[link + 1]
        spin = 0.0
        for m in range(5):
            A[m] = moving * mass[link] * (p[m + 2] + com[link] * b[m + 2])
            spin += moving * BINOMIAL[4, m] * b[m] * b[6 - m]
        A[0] += mass[link] * gravity
        for i in range(link + 1):
            for m in range(5):
                V[m] = B[i, m] if prismatic[i] else p[m] - P[i + 1, m] + com[link] * b[m]
            total = 0.0 if prismatic[i] else half[link] * spin
            for m in range(5):
                total += BINOMIAL[4, m] * V[m] * A[4 - m]
            out[i] += total


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
TORQUE_FLOOR, MOTOR_FLOOR = 1e-2, 1e-5
"""Least fractions of a limit on a joint's and on a motor's torque that the excess is relative to."""
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
    left, right : (m, 2, n) array
        Torques and their rates, without Coulomb friction, of joints or motors [N·m, N, N·m/s, N/s].
    fourths : (m, n) array
        Bounds on the fourth derivatives of these torques within the pieces [N·m/s⁴, N/s⁴].
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


class Model(NamedTuple):
    """An arm, its load, the sizes of both, the part of the torque, the relations of its axes, and its coupled motors if any."""

    chain: Chain
    load: Load
    sizes: Sizes
    part: int
    linkage: Linkage | None
    gears: Gears | None

    @property
    def coulomb(self) -> Array:
        """Coulomb friction (n,) of the joints or the motors [N·m, N]."""
        return self.load.coulomb if self.gears is None else self.gears.coulomb

    def turn(self, joints: Array) -> Array:
        """Return the derivatives (k, i, n) of joints, or those of the motors without their offset."""
        return joints if self.gears is None else np.ascontiguousarray(joints @ self.gears.turns.T)

    def drive(self, torques: Array) -> Array:
        """Return the torques (..., n) of axes at the joints, or at the motors."""
        return torques if self.gears is None else torques @ self.gears.matrix.T


class TorqueBounds:
    """A motion with its torques; the torques at the ends of its pieces are cached."""

    def __init__(
        self, robot: Robot, knots: Array, first: Array, last: Array, *, still: bool = False, gears: Gears | None = None
    ) -> None:
        part = GRAVITY if still else ALL
        self.models = tuple(
            Model(robot.chain, load, sizes(robot, load), part, robot.linkage, gears) for load in robot.loads
        )
        self.ends: list[TorqueEnds] = []
        for model in self.models:
            left, right = evaluate_torques(model, first), evaluate_torques(model, last)
            fourths = bound_fourths(model, np.diff(knots), first)
            self.ends.append(TorqueEnds(knots[:-1], knots[1:], first, last, left, right, fourths))
        self._kept: dict[tuple[bool, bytes], TorqueRatios] = {}

    def bound_ratios(
        self, limit: Array, *, rate: bool, excess: float = TORQUE_EXCESS, most: int = TORQUE_INTERVALS
    ) -> TorqueRatios:
        """Return bounds on the ratios of the torques, or of their rates, to their limits; results are cached."""
        key = (rate, np.array([*np.ravel(limit), excess, most]).tobytes())
        if key not in self._kept:
            each = [
                _bound_load(model, ends, limit, (rate, excess, most))
                for model, ends in zip(self.models, self.ends, strict=True)
            ]
            self._kept[key] = each[0] if len(each) == 1 else _select_worse(*each)
        return self._kept[key]

    def piece_ratios(self, limit: Array, *, rate: bool) -> Array:
        """Return the ratios of joint torques, or of their rates, to the limits: on each piece the larger end value."""
        lower, upper = limit
        worst = np.zeros((len(self.ends[0].t0), upper.size))
        for model, ends in zip(self.models, self.ends, strict=True):
            for joints, values in ((ends.first, ends.left), (ends.last, ends.right)):
                value = values[:, 1] if rate else values[:, 0] + model.coulomb * np.sign(model.turn(joints[:, 1]))
                worst = np.maximum(worst, np.where(value < 0.0, value / lower, value / upper))
        return np.asarray(worst)


def _select_worse(a: TorqueRatios, b: TorqueRatios) -> TorqueRatios:
    """Return, joint by joint, the larger torque ratios of two loads."""
    first = a.ratio >= b.ratio
    return TorqueRatios(*(np.where(first, x, y) for x, y in zip(a, b, strict=True)))


def _bound_load(model: Model, ends: TorqueEnds, limit: Array, how: tuple[bool, float, int]) -> TorqueRatios:
    """Return bounds on the torque ratios of one load; `how` is (for the rates, relative excess, greatest interval count)."""
    rate, excess, most = how
    lower, upper = limit
    limits = np.stack([-lower, upper])
    limits = np.where(np.isfinite(limits), limits, 1.0)
    n = upper.size
    rest = rest_velocity(model, ends)
    coulomb = np.zeros(n) if rate else np.array(model.coulomb)
    results = np.zeros((2, n)), np.zeros((2, n)), np.zeros((2, n))
    floor = TORQUE_FLOOR if model.gears is None else MOTOR_FLOOR
    close = (1.0 + excess, floor, NARROWEST * float(ends.t1[-1]))
    _divide(model, ends, (coulomb, 1.0 / limits, rate, rest), most, close, results)
    proved, found, when = results
    above = proved[1] >= proved[0]
    ratio, largest, time = (np.where(above, x[1], x[0]) for x in (proved, found, when))
    return TorqueRatios(ratio, largest, time, above)


def rest_velocity(model: Model, ends: TorqueEnds) -> float:
    """Return the velocity below which a joint is at rest."""
    return STANDSTILL * max(float(np.abs(model.turn(each[:, 1])).max()) for each in (ends.first, ends.last))


def evaluate_torques(model: Model, joints: Array) -> Array:
    """Return torques and their rates (k, 2, n), without Coulomb friction."""
    load, gears, part = model.load, model.gears, model.part
    states, out = np.ascontiguousarray(joints[:, :4]), np.empty((len(joints), 2, joints.shape[2]))
    torques_batch(model.chain, load.bodies, load.viscous if part == ALL else _nothing(load.viscous), states, out)
    if part != ALL:
        kinetic = np.empty_like(out)
        bodies = (*load.bodies[:4], _nothing(load.bodies[4]))
        torques_batch(model.chain, bodies, _nothing(load.viscous), states, kinetic)
        out = kinetic if part == MOTION else out - kinetic
    if gears is None:
        return out
    turned, driven = model.turn(states[:, 1:]), model.drive(out)
    if part != GRAVITY:
        driven += gears.inertia * turned[:, 1:]
    return driven + gears.viscous * turned[:, :2] if part == ALL else driven


def _nothing(like: Array) -> Array:
    """Return zeros like an array, read-only if it is, so that kernels are compiled once."""
    zeros = np.zeros_like(like)
    zeros.setflags(write=like.flags.writeable)
    return zeros


def at_middle(model: Model, ends: TorqueEnds) -> tuple[Array, Array]:
    """Return the joints' derivatives and the torques in the middle of every piece."""
    joints = np.empty_like(ends.first)
    _advance(ends.first, 0.5 * (ends.t1 - ends.t0), joints)
    return joints, evaluate_torques(model, joints)


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
    proved, largest, when = results
    fourths = ends.fourths
    _update_largest(t, model.turn(joints), left, what, largest, when)
    _update_largest(ends.t1, model.turn(ends.last), right, what, largest, when)
    while True:
        bound = np.empty((t.size, 2, largest.shape[1]))
        _between(what, h, model.turn(joints), fourths, (left, right), bound)
        loose = _find_loose(bound, h, largest, close, most, proved)
        if not loose.any():
            break
        t, h, joints, left, right = t[loose], 0.5 * h[loose], joints[loose], left[loose], right[loose]
        most -= t.size
        later = np.empty_like(joints)
        _advance(joints, h, later)
        middle = evaluate_torques(model, later)
        _update_largest(t + h, model.turn(later), middle, what, largest, when)
        t, h, joints = np.concatenate([t, t + h]), np.concatenate([h, h]), np.concatenate([joints, later])
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
        fourths = bound_fourths(model, h, joints)
    np.maximum(proved, largest, out=proved)


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


def bound_fourths(model: Model, h: Array, joints: Array) -> Array:
    """Return what `_fourths` computes; of a linkage with the derivatives of the axes, whose torques move the joints."""
    follow, gears, still, axes = model.linkage, model.gears, model.part == GRAVITY, joints
    if follow is not None:
        axes = joints[..., follow.joint] * follow.factor
        axes[:, 0] += follow.offset
    out = np.empty(axes[:, 0].shape)
    _fourths(model.sizes, still, h, axes, out)
    if follow is not None:
        return np.asarray(out @ np.abs(follow.matrix))
    if gears is None:
        return out
    return out @ np.abs(gears.matrix).T + (0.0 if still else gears.viscous * np.abs(model.turn(joints[:, 5])))


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
