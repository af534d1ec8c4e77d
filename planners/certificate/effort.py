"""Load of a motion on its motors: energy, power, and steps of Coulomb friction where joints start, reverse and stop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array
from planners.certificate.torque import Ends, Model, TorqueBounds, at_middle, rest_velocity
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


def _energy(model: Model, ends: Ends) -> Energy:
    """Return the energy of one load, by quadrature from powers and their rates at the ends and in the middle of every piece."""
    h, coulomb = (ends.t1 - ends.t0)[:, None], model[1].coulomb
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
    coulomb, still, found = torques.models[0][1].coulomb, rest_velocity(torques.ends[0]), []
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
