"""Load of a motion on its motors: energy, power, friction steps, and the factor that stretches it to respect limits.

A motion that is x times as fast has the torques g + b x + a x², with the torque g of gravity, viscous friction b and inertia a;
Coulomb friction is unchanged. Its torque rates are g' x + b' x² + a' x³. No factor suffices if gravity alone exceeds a limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array
from planners.certificate.torque import (
    MOTION,
    Model,
    TorqueBounds,
    TorqueEnds,
    at_middle,
    evaluate_torques,
    rest_velocity,
)
from planners.trajectory import Trajectory


class Energy(NamedTuple):
    """Mechanical energy and power at the joints, friction included, for the load that needs more.

    Attributes
    ----------
    net : float
        ∫ Σ τ q̇ dt [J], by quadrature.
    drawn : float
        The same for driving joints only: braking joints recover no energy [J].
    power : float
        Largest power Σ τ q̇ at the ends and in the middle of the pieces [W]; not a proved bound.
    time : float
        Its time [s].
    """

    net: float
    drawn: float
    power: float
    time: float


class FrictionStep(NamedTuple):
    """A step of a joint's torque by Coulomb friction: its time [s], joint and size [N·m, N]."""

    t: float
    joint: str
    size: float


def energy(torques: TorqueBounds) -> Energy:
    """Return the energy and the power of a motion."""
    each = [_energy(model, ends) for model, ends in zip(torques.models, torques.ends, strict=True)]
    return max(each, key=lambda of: of.drawn)


def _energy(model: Model, ends: TorqueEnds) -> Energy:
    """Return the energy of one load, by quadrature from powers and their rates at the ends and in the middle of every piece."""
    h, coulomb = (ends.t1 - ends.t0)[:, None], model.coulomb
    half = at_middle(model, ends)
    powers, rates = [], []
    for joints, values in ((ends.first, ends.left), (ends.last, ends.right), half):
        velocity, acceleration = joints[:, 1], joints[:, 2]
        torque = values[:, 0] + coulomb * np.sign(velocity)
        powers.append(torque * velocity)
        rates.append(values[:, 1] * velocity + torque * acceleration)
    a, b, middle = powers
    work = h / 30.0 * (7.0 * (a + b) + 16.0 * middle) + h * h / 60.0 * (rates[0] - rates[1])
    rough = 0.5 * h * (_positive(a, middle) + _positive(middle, b))
    driving = np.where((a >= 0.0) & (b >= 0.0) & (middle >= 0.0), work, rough)
    total = np.concatenate([power.sum(axis=1) for power in powers])
    t = np.concatenate([ends.t0, ends.t1, 0.5 * (ends.t0 + ends.t1)])
    k = int(total.argmax())
    return Energy(float(work.sum()), float(np.maximum(driving, 0.0).sum()), float(total[k]), float(t[k]))


def _positive(a: Array, b: Array) -> Array:
    """Return the mean of the positive part of a linear function from a to b."""
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = 0.5 * np.maximum(a, b) ** 2 / np.abs(a - b)
    return np.where(a * b < 0.0, crossing, 0.5 * (np.maximum(a, 0.0) + np.maximum(b, 0.0)))


def friction_steps(
    robot: Robot, trajectory: Trajectory, torques: TorqueBounds, rest: tuple[bool, bool]
) -> tuple[FrictionStep, ...]:
    """Return the steps of Coulomb friction: f where a joint starts or stops, 2 f where it reverses."""
    model, found = torques.models[0], []
    coulomb, still = model.coulomb, rest_velocity(model, torques.ends[0])
    least, greatest = trajectory.piece_range(1)
    for i in np.flatnonzero(coulomb > 0.0):
        roots = [_roots(trajectory, int(k), int(i)) for k in np.flatnonzero(least[:, i] * greatest[:, i] < 0.0)]
        t = np.unique(np.concatenate([trajectory.knots, *roots]))
        velocity = trajectory(0.5 * (t[1:] + t[:-1]), 1)[:, i]
        sign = np.where(np.abs(velocity) > still, np.sign(velocity), 0.0)
        sign = np.concatenate([[0.0] if rest[0] else sign[:1], sign, [0.0] if rest[1] else sign[-1:]])
        steps = np.abs(np.diff(sign)) * coulomb[i]
        found += [FrictionStep(float(t[k]), robot.joint_names[i], float(steps[k])) for k in np.flatnonzero(steps)]
    return tuple(sorted(found))


def _roots(trajectory: Trajectory, piece: int, joint: int) -> Array:
    """Return the times at which a joint's velocity is 0 inside a piece."""
    start, end = trajectory.knots[piece : piece + 2]
    roots = np.roots(np.polyder(trajectory.padded[:, piece, joint]))
    real = roots.real[np.abs(roots.imag) <= 1e-9 * (end - start)]
    return np.asarray(start + real[(real > 0.0) & (real < end - start)])


MOST_HASTENED = 1e6
"""Greatest factor of speed that is tried: a motion that respects its limits there is not limited by them."""
SLOWING_ROUNDS = 100
"""Largest number of steps of the search for the factor; about ten are usual."""


class _Parts(NamedTuple):
    """Coefficients of powers 0 to 3 of the speed (k, 4, n), and friction on both sides (k, 2, n), at k instants."""

    powers: Array
    friction: Array


def find_torque_stretch(torques: TorqueBounds, limit: Array, *, rate: bool) -> float:
    """Return the least factor by which a motion is stretched in time to respect the limits at the ends of its pieces.

    The excess of each joint's proved bound over its largest value there is added, with the highest power of the speed. So the
    proof of the stretched motion nearly succeeds.
    """
    proved = torques.bound_ratios(limit, rate=rate).ratio
    parts = [_parts(model, ends, rate) for model, ends in zip(torques.models, torques.ends, strict=True)]
    powers, friction = (np.concatenate(part) for part in zip(*parts, strict=True))
    limited = np.isfinite(limit[1])
    weights = np.where(limited, 1.0 / np.where(limited, limit, 1.0), 0.0)
    excess, there = np.zeros(proved.size), np.empty(proved.size)
    kept = (powers, friction, weights, excess, 3 if rate else 2)
    _worst(kept, 1.0, there)
    excess[:] = np.where(limited, np.maximum(proved - there, 0.0), 0.0)
    return _least(kept)


def _parts(model: Model, ends: TorqueEnds, rate: bool) -> _Parts:
    """Return the parts of the torques, or of their rates, at both ends of all pieces."""
    joints, values = np.concatenate([ends.first, ends.last]), np.concatenate([ends.left, ends.right])
    turned, load, first, order = model.turn(joints), model.load, 1 if rate else 0, 2 if rate else 1
    kinetic = evaluate_torques(model._replace(part=MOTION), joints)
    powers = np.zeros((len(joints), 4, turned.shape[2]))
    viscous = model.drive(load.viscous * joints[:, order])
    if model.gears is not None:
        viscous += model.gears.viscous * turned[:, order]
    powers[:, first + 1], powers[:, first + 2] = viscous, kinetic[:, first]
    powers[:, first] = values[:, first] - viscous - kinetic[:, first]
    friction = np.zeros((len(joints), 2, turned.shape[2]))
    if not rate:
        still, sign = np.abs(turned[:, 1]) <= rest_velocity(model, ends), np.sign(turned[:, 1])
        friction[:, 0] = model.coulomb * np.where(still, -1.0, sign)
        friction[:, 1] = model.coulomb * np.where(still, 1.0, sign)
    return _Parts(powers, friction)


_RatioTerms = tuple[Array, Array, Array, Array, int]
"""Terms of the ratios: powers, friction, weights (2, n) of both sides, which are 1 over the limits, the excess (n,) of the
bounds over the largest ratios, and its power of the speed."""


@compiled
def _worst(kept: _RatioTerms, x: float, out: Array) -> float:
    """Compute each joint's largest ratio (n,) to its torque or rate limit at x times the speed; return the largest of all.

    Returns [1].
    """
    powers, friction, weights, excess, power = kept
    most = 0.0
    for i in range(out.shape[0]):
        out[i] = 0.0
        for k in range(powers.shape[0]):
            value = powers[k, 0, i] + x * (powers[k, 1, i] + x * (powers[k, 2, i] + x * powers[k, 3, i]))
            for side in range(2):
                out[i] = max(out[i], weights[side, i] * (value + friction[k, side, i]))
        out[i] += excess[i] * x**power
        most = max(most, out[i])
    return most


@compiled
def _least(kept: _RatioTerms) -> float:
    """Return the stretch factor 1 / x at which the largest ratio to a limit is 1, by regula falsi (Illinois)."""
    spare = np.empty(kept[3].shape[0])
    low, high = 0.0, 1.0
    f_high = _worst(kept, high, spare) - 1.0
    if f_high > 0.0:
        f_low = _worst(kept, low, spare) - 1.0
        if f_low > 0.0:
            return np.inf
    else:
        low, f_low = high, f_high
        while f_high <= 0.0:
            if high >= MOST_HASTENED:
                return 0.0
            low, f_low = high, f_high
            high *= 2.0
            f_high = _worst(kept, high, spare) - 1.0
    last = 0
    for _ in range(SLOWING_ROUNDS):
        if high - low <= 1e-15 * high or f_low == 0.0:
            break
        x = (low * f_high - high * f_low) / (f_high - f_low)
        if not low < x < high:
            x = 0.5 * (low + high)
        f = _worst(kept, x, spare) - 1.0
        if f > 0.0:
            high, f_high = x, f
            f_low = 0.5 * f_low if last == 1 else f_low
            last = 1
        else:
            low, f_low = x, f
            f_high = 0.5 * f_high if last == -1 else f_high
            last = -1
    return 1.0 / low if low > 0.0 else np.inf
