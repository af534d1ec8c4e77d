"""Greatest torque and greatest rate of the torque of every joint along a trajectory: proved upper bounds, not samples.

Coulomb friction counts in the torque as f sign(q̇) where the sign of the velocity is proved constant on an interval, and as
the whole set [−f, f] where a joint rests or reverses: in an interval with a change of sign, and at instants of rest.
The rate is that of the torque without Coulomb friction, which jumps there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.inertia import Load
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.dynamics import rigid_torques
from optik.kinematics import Chain
from optik.types import Array, Indices
from planners.certificate.bounds import joint_bounds
from planners.certificate.torque_bounds import (
    RATE_REMAINDER,
    VALUE_REMAINDER,
    Sizes,
    cubic_range,
    direction,
    fourth_bounds,
    sizes,
    slope_range,
)

TORQUE_EXCESS = 1e-5
"""Largest excess of the bound over the largest value found, as a share of it."""
TORQUE_FLOOR = 1e-2
"""Share of a limit below which the excess is counted from here: a joint that uses less of it needs no finer figure."""
TORQUE_INTERVALS = 200_000
"""Most intervals: a second of computing; a motion that needs more keeps the bound it has then."""
NARROWEST = 1e-9
"""Share of a motion's duration below which an interval is not divided any more: rounding in t is near."""
STANDSTILL = 1e-9
"""Share of the largest velocity of all joints below which a joint is at rest at an instant: rounding of the polynomials."""
DEEPEST = 64
"""Intervals that wait at most while one piece is halved: more than the halvings down to the narrowest."""


class Proved(NamedTuple):
    """What is proved of every joint (n,); the limits are 1 where a joint is free.

    Attributes
    ----------
    ratio, found : (n,) array
        The proved bound on a value over its limit, and the largest ratio found [1].
    time : (n,) array
        When it was found [s].
    upper : (n,) array of bool
        Whether it is on the upper side.
    """

    ratio: Array
    found: Array
    time: Array
    upper: Array


class Ends(NamedTuple):
    """A motion at the first and at the last instant of every piece.

    Attributes
    ----------
    t0, t1 : (m,) array
        Times [s].
    first, last : (m, 6, n) array
        The joints' derivatives [rad/s^i, m/s^i].
    left, right : (m, 2, n) array
        Torques and their rates, without Coulomb friction [N·m, N, N·m/s, N/s].
    """

    t0: Array
    t1: Array
    first: Array
    last: Array
    left: Array
    right: Array


ALL, GRAVITY, MOTION = 0, 1, 2
"""What counts of the torque: all but Coulomb friction, only what holds the arm against gravity, or what moves its masses."""
Model = tuple[Chain, Load, Sizes, int]
"""An arm, what its joints move, the sizes of both, and what counts of the torque."""


class TorqueBounds:
    """A motion with its torques: those at the ends of its pieces are computed once.

    Parameters
    ----------
    robot : Robot
        The arm, whose masses are known.
    knots : (m + 1,) array
        Times of the ends of its pieces [s].
    first, last : (m, 6, n) arrays
        Derivatives of the joints of order 0 to 5 at the ends of the pieces [rad/s^i, m/s^i].
    still : bool
        Whether only the torque against gravity counts, with Coulomb friction. The parameter of the motion need not be time.

    Raises
    ------
    InvalidInput
        The masses of the arm are unknown.
    """

    def __init__(self, robot: Robot, knots: Array, first: Array, last: Array, *, still: bool = False) -> None:
        self.models: tuple[Model, ...] = tuple(
            (robot.chain, load, sizes(robot, load), GRAVITY if still else ALL) for load in robot.loads
        )
        self.ends: list[Ends] = []
        for model in self.models:
            left, right = (np.empty((len(first), 2, robot.n)) for _ in range(2))
            torques_at(model, first, left)
            torques_at(model, last, right)
            self.ends.append(Ends(knots[:-1], knots[1:], first, last, left, right))
        self._kept: dict[tuple[bool, bytes], Proved] = {}

    def proved(
        self, bound: Array, *, rate: bool, excess: float = TORQUE_EXCESS, most: int = TORQUE_INTERVALS
    ) -> Proved:
        """Bound the torques, or their rates, over their limits at every instant; found once, then kept.

        Parameters
        ----------
        bound : (2, n) array
            Lower and upper limits [N·m, N, N·m/s, N/s]; infinite where free.
        rate : bool
            Whether the rates are bounded, and not the torques.
        excess : float
            Largest excess of the bound over the largest value found, as a share of it [1].
        most : int
            How often an interval is halved at most.

        Returns
        -------
        Proved
            The worst of all loads.
        """
        key = (rate, np.array([*np.ravel(bound), excess, most]).tobytes())
        if key not in self._kept:
            each = [
                _of_load(model, ends, bound, (rate, excess, most))
                for model, ends in zip(self.models, self.ends, strict=True)
            ]
            self._kept[key] = each[0] if len(each) == 1 else _worse(*each)
        return self._kept[key]

    def piece_ratios(self, bound: Array, *, rate: bool) -> Array:
        """Larger of the ratios at both ends of every piece.

        Parameters
        ----------
        bound : (2, n) array
            Lower and upper limits [N·m, N, N·m/s, N/s]; infinite where free.
        rate : bool
            Whether of the rates, and not of the torques.

        Returns
        -------
        (m, n) array
            Ratios [1]; 0 where free.
        """
        lower, upper = bound
        worst = np.zeros((len(self.ends[0].t0), upper.size))
        for model, ends in zip(self.models, self.ends, strict=True):
            for joints, values in ((ends.first, ends.left), (ends.last, ends.right)):
                value = values[:, 1] if rate else values[:, 0] + model[1].coulomb * np.sign(joints[:, 1])
                worst = np.maximum(worst, np.where(value < 0.0, value / lower, value / upper))
        return np.asarray(worst)


def _worse(a: Proved, b: Proved) -> Proved:
    """The worse of two loads, joint by joint."""
    first = a.ratio >= b.ratio
    return Proved(*(np.where(first, x, y) for x, y in zip(a, b, strict=True)))


def _of_load(model: Model, ends: Ends, bound: Array, how: tuple[bool, float, int]) -> Proved:
    """The bounds of one load; how: whether of the rates, the excess, and how often an interval is halved at most."""
    rate, excess, most = how
    lower, upper = bound
    limits = np.stack([-lower, upper])
    limits = np.where(np.isfinite(limits), limits, 1.0)
    n = upper.size
    rest = resting(ends)
    coulomb = np.zeros(n) if rate else np.array(model[1].coulomb)
    proved, found, when = np.zeros((2, n)), np.zeros((2, n)), np.zeros((2, n))
    close = (1.0 + excess, TORQUE_FLOOR, NARROWEST * float(ends.t1[-1]))
    _prove(model, ends, (coulomb, 1.0 / limits, rate, rest), most, close, (proved, found, when))
    above = proved[1] >= proved[0]
    ratio, largest, time = (np.where(above, x[1], x[0]) for x in (proved, found, when))
    return Proved(ratio, largest, time, above)


def resting(ends: Ends) -> float:
    """Velocity below which a joint is at rest at an instant.

    Parameters
    ----------
    ends : Ends
        A motion.

    Returns
    -------
    float
        [rad/s, m/s].
    """
    return STANDSTILL * max(float(np.abs(ends.first[:, 1]).max()), float(np.abs(ends.last[:, 1]).max()))


@compiled
def _torque(model: Model, joints: Array, work: Array, out: Array) -> None:
    """Torques and their rates (2, n) at an instant, without Coulomb friction."""
    chain, load, _, part = model
    n = out.shape[1]
    found = np.empty((2, 2, n))
    for k in range(2 if part == GRAVITY else 1):  # one place of the call: its code is long
        weight = 0.0 if part == MOTION else 1.0 - k
        rigid_torques(chain, load.bodies, weight, joints[:4], work, found[k])
    for order in range(2):
        for i in range(n):
            out[order, i] = found[0, order, i]
            if part == GRAVITY:
                out[order, i] -= found[1, order, i]
            elif part == ALL:
                out[order, i] += load.viscous[i] * joints[order + 1, i]


@compiled
def torques_at(model: Model, joints: Array, out: Array) -> None:
    """Torques and their rates, without Coulomb friction.

    Parameters
    ----------
    model : Model
        The arm, its load, and what counts.
    joints : (k, 6, n) array
        Derivatives of the joints at instants [rad/s^i, m/s^i].
    out : (k, 2, n) array
        Filled [N·m, N, N·m/s, N/s].
    """
    work = np.empty((8, joints.shape[2] + 1, 4, 4))
    for k in range(joints.shape[0]):
        _torque(model, joints[k], work, out[k])


def at_middle(model: Model, ends: Ends) -> tuple[Array, Array]:
    """Return a motion in the middle of every piece.

    Parameters
    ----------
    model : Model
        The arm and its load.
    ends : Ends
        The motion at the ends of the pieces.

    Returns
    -------
    tuple of (m, 6, n) and (m, 2, n) arrays
        The joints' derivatives [rad/s^i, m/s^i], and torques and their rates without Coulomb friction [N·m, N, N·m/s, N/s].
    """
    joints, values = np.empty_like(ends.first), np.empty_like(ends.left)
    for k in range(len(joints)):
        _shifted(ends.first[k], 0.5 * float(ends.t1[k] - ends.t0[k]), joints[k])
    torques_at(model, joints, values)
    return joints, values


@compiled
def _shifted(joints: Array, t: float, out: Array) -> None:
    """Derivatives of quintics (6, n) later by t, from those at an instant."""
    for i in range(joints.shape[1]):
        for order in range(6):
            value = joints[5, i]
            for m in range(4, order - 1, -1):
                value = joints[m, i] + value * t / (m + 1 - order)
            out[order, i] = value


What = tuple[Array, Array, bool, float]
"""What is bounded: Coulomb friction (n,) that counts, weights (2, n) of the lower and the upper side, which are 1 over the
sizes of the limits, whether of the rates, and the velocity of a joint at rest."""


@compiled
def _prove(
    model: Model, ends: Ends, what: What, most: int, close: tuple[float, float, float],
    results: tuple[Array, Array, Array],
) -> int:  # fmt: skip
    """Bound all pieces, those with the largest values first: into results, proved, found and when (2, n).

    close: the factor, the floor and the narrowest interval. Each piece is halved until its bounds are close.

    Returns
    -------
    int
        How many times an interval was halved.
    """
    proved, found, when = results
    count, n, kind = ends.left.shape[0], what[0].shape[0], int(what[2])
    peak, spare, halved = np.zeros((count, n)), np.empty(n), 0
    for k in range(count):
        _note(ends.t0[k], ends.first[k, 1], ends.left[k, kind], what, found, when, peak[k])
        _note(ends.t1[k], ends.last[k, 1], ends.right[k, kind], what, found, when, peak[k])
    span, joints, values = np.empty((DEEPEST, 2)), np.empty((DEEPEST, 6, n)), np.empty((DEEPEST, 4, n))
    bound = np.empty((2, n))
    work = (np.empty((8, n + 1, 4, 4)), np.empty((2, n + 1, 7)), np.empty((1, 6, n)), np.empty(n))
    for k in _order(peak, found, close[1]):
        top = 0
        span[0, 0], span[0, 1] = 0.0, ends.t1[k] - ends.t0[k]
        joints[0], values[0, :2], values[0, 2:] = ends.first[k], ends.left[k], ends.right[k]
        while top >= 0:
            t, h = span[top, 0], span[top, 1]
            _within(model, what, h, joints[top : top + 1], values[top], bound, work)
            divisible = h > close[2] and halved < most and top < DEEPEST - 1
            if not (divisible and _loose(bound, found, close[0], close[1])):
                for i in range(n):
                    proved[0, i], proved[1, i] = max(proved[0, i], bound[0, i]), max(proved[1, i], bound[1, i])
                top -= 1
                continue
            halved += 1
            _halve(model, ends.first[k], (span, joints, values), top, work)
            top += 1  # the right half lies below the left one
            middle, at = values[top - 1, kind], ends.t0[k] + t + 0.5 * h
            _note(at, joints[top - 1, 1], middle, what, found, when, spare)
    for i in range(n):
        proved[0, i], proved[1, i] = max(proved[0, i], found[0, i]), max(proved[1, i], found[1, i])
    return halved


@compiled
def _note(t: float, velocity: Array, value: Array, what: What, found: Array, when: Array, peak: Array) -> None:
    """Keep the largest ratios at an instant, and its time; the larger of both sides into peak (n,) where that is larger."""
    coulomb, weights, _, rest = what
    for i in range(value.shape[0]):
        still = abs(velocity[i]) <= rest
        f = coulomb[i] * np.sign(velocity[i])
        low = -weights[0, i] * (value[i] - coulomb[i] if still else value[i] + f)
        high = weights[1, i] * (value[i] + (coulomb[i] if still else f))
        if low > found[0, i]:
            found[0, i], when[0, i] = low, t
        if high > found[1, i]:
            found[1, i], when[1, i] = high, t
        peak[i] = max(peak[i], low, high)


@compiled
def _order(peak: Array, found: Array, floor: float) -> Indices:
    """Pieces, those first whose values come nearest to the largest of a joint."""
    near = np.zeros(peak.shape[0])
    for k in range(peak.shape[0]):
        for i in range(peak.shape[1]):
            near[k] = max(near[k], peak[k, i] / max(found[0, i], found[1, i], floor))
    return np.argsort(-near)


@compiled
def _loose(bound: Array, found: Array, factor: float, floor: float) -> bool:
    """Whether a bound is not yet close to the largest value of a joint."""
    loose = False
    for i in range(bound.shape[1]):
        loose |= max(bound[0, i], bound[1, i]) > factor * max(found[0, i], found[1, i], floor)
    return loose


@compiled
def _within(
    model: Model, what: What, h: float, joints: Array, values: Array, bound: Array,
    work: tuple[Array, Array, Array, Array],
) -> None:  # fmt: skip
    """Bounds (2, n) on the ratios to both sides in an interval, from the joints' derivatives at its start (1, 6, n).

    values (4, n): torque and rate at the start and at the end.
    """
    coulomb, weights, rate, rest = what
    _, space, D, fourth = work
    joint_bounds(joints, np.full(1, h), D)
    fourth_bounds(model[2], D[0], model[3] == GRAVITY, space, fourth)
    for i in range(coulomb.shape[0]):
        a, c, b, d = values[0, i], values[1, i], values[2, i], values[3, i]
        if rate:
            low, high = slope_range(a, b, c, d, h)
            off = RATE_REMAINDER * h**3 * fourth[i]
        else:
            low, high = cubic_range(a, b, c, d, h)
            off = VALUE_REMAINDER * h**4 * fourth[i]
        low, high = low - off, high + off
        f = coulomb[i]
        if f > 0.0:
            sense, start, end = direction(joints[0, 1:, i], h)
            below, above = low - f, high + f
            low, high = (low + sense * f, high + sense * f) if sense != 0 else (below, above)
            if abs(start) <= rest:
                low, high = min(low, a - f), max(high, a + f)
            if abs(end) <= rest:
                low, high = min(low, b - f), max(high, b + f)
        bound[0, i], bound[1, i] = -weights[0, i] * low, weights[1, i] * high


@compiled
def _halve(
    model: Model, first: Array, stack: tuple[Array, Array, Array], top: int,
    work: tuple[Array, Array, Array, Array],
) -> None:  # fmt: skip
    """Put both halves of the interval on top of the stack in its place, the right one first.

    first (6, n): the joints' derivatives at the start of the piece.
    """
    span, joints, values = stack
    t, half = span[top, 0], 0.5 * span[top, 1]
    span[top + 1, 0], span[top + 1, 1] = t, half
    joints[top + 1], values[top + 1, :2] = joints[top], values[top, :2]
    span[top, 0], span[top, 1] = t + half, half
    _shifted(first, t + half, joints[top])
    _torque(model, joints[top], work[0], values[top, :2])
    values[top + 1, 2:] = values[top, :2]
