"""Factor by which a motion is stretched in time until its torques or their rates just respect their limits.

A motion that is x times as fast has the torques g + b x + a x², with the torque g of gravity, viscous friction b and inertia a;
Coulomb friction is unchanged. Its torque rates are g' x + b' x² + a' x³. No factor suffices if gravity alone exceeds a limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.compiled import compiled
from optik.types import Array
from planners.certificate.torque import MOTION, Ends, Model, TorqueBounds, rest_velocity, torques_at

MOST_HASTENED = 1e6
"""Greatest factor of speed that is tried: a motion that respects its limits there is not limited by them."""
SLOWING_ROUNDS = 100
"""Largest number of steps of the search for the factor; about ten are usual."""


class _Parts(NamedTuple):
    """Coefficients of powers 0 to 3 of the speed (k, 4, n), and friction on both sides (k, 2, n), at k instants."""

    powers: Array
    friction: Array


def stretch_factor(torques: TorqueBounds, bound: Array, *, rate: bool) -> float:
    """Return the least factor by which a motion is stretched in time to respect the limits at the ends of its pieces.

    The excess of each joint's proved bound over its largest value there is added, with the highest power of the speed. So the
    proof of the stretched motion nearly succeeds.
    """
    proved = torques.bound_ratios(bound, rate=rate).ratio
    parts = [_parts(model, ends, rate) for model, ends in zip(torques.models, torques.ends, strict=True)]
    powers, friction = (np.concatenate(part) for part in zip(*parts, strict=True))
    limited = np.isfinite(bound[1])
    weights = np.where(limited, 1.0 / np.where(limited, bound, 1.0), 0.0)
    excess, there = np.zeros(proved.size), np.empty(proved.size)
    kept = (powers, friction, weights, excess, 3 if rate else 2)
    _worst(kept, 1.0, there)
    excess[:] = np.where(limited, np.maximum(proved - there, 0.0), 0.0)
    return _least(kept)


def _parts(model: Model, ends: Ends, rate: bool) -> _Parts:
    """Return the parts of the torques, or of their rates, at both ends of all pieces."""
    joints, values = np.concatenate([ends.first, ends.last]), np.concatenate([ends.left, ends.right])
    load = model[1]
    kinetic = np.empty_like(values)
    torques_at((*model[:3], MOTION), joints, kinetic)
    powers = np.zeros((len(joints), 4, joints.shape[2]))
    viscous = load.viscous * joints[:, 2 if rate else 1]
    first = 1 if rate else 0
    powers[:, first + 1], powers[:, first + 2] = viscous, kinetic[:, first]
    powers[:, first] = values[:, first] - viscous - kinetic[:, first]
    friction = np.zeros((len(joints), 2, joints.shape[2]))
    if not rate:
        still = np.abs(joints[:, 1]) <= rest_velocity(ends)
        sign = np.sign(joints[:, 1])
        friction[:, 0] = load.coulomb * np.where(still, -1.0, sign)
        friction[:, 1] = load.coulomb * np.where(still, 1.0, sign)
    return _Parts(powers, friction)


_RatioTerms = tuple[Array, Array, Array, Array, int]
"""Terms of the ratios: powers, friction, weights (2, n) of both sides, which are 1 over the limits, the excess (n,) of the
bounds over the largest ratios, and its power of the speed."""


@compiled
def _worst(kept: _RatioTerms, x: float, out: Array) -> float:
    """Compute the largest ratio of each joint (n,) at x times the speed; return the largest of all.

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
    """Return the factor, from the speed at which the largest ratio is 1, by regula falsi (Illinois)."""
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
