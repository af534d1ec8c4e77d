"""Position servos of simulated motors: gains from the arm's inertia, and the control law at every step of the plant."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.types import Array

BANDWIDTH = 10.0
"""Default natural frequency of the servos [Hz]: position loops of industrial arms are below the first resonance of their
gears, some 10 to 20 Hz."""

DAMPING = 1.0
"""Default damping ratio of the servos [1]: without the velocity filter there is no overshoot."""

FILTER_TIME = 0.25
"""Time constant of the velocity filter times the natural frequency in rad/s [1]: 4 ms at 10 Hz. A larger one makes the loop
ring (the damping ratio of its fast part is 0.65), a smaller one makes the motors follow the counts of the encoders."""

FASTEST_GAIN = 1.0
"""Largest velocity gain, and natural frequency in rad/s, times the step of the plant [1]: with a larger one a servo
overcorrects in one step, and motors oscillate between their limits (from 160 Hz at 0.5 ms)."""

EXAMINED = 20
"""Number of random configurations at which the inertia of every joint is checked."""

FULL_TURN = pi
"""Largest absolute position of the sampled configurations [rad, m]: joints without limits repeat after a turn."""


class Gains(NamedTuple):
    """The gains (n,) of the servos: accelerations per error; the mass matrix times these accelerations is the torque."""

    frequency: Array  # natural frequency ω [rad/s]; its square is the position gain [1/s²]
    damping: Array  # velocity gain 2 ζ ω [1/s]
    filter: Array  # time constant of the velocity filter [s]


def compute_gains(robot: Robot, bandwidth: ArrayLike, damping: ArrayLike) -> Gains:
    """Return the gains with which the error of every joint decays as that of a mass with a spring and a damper."""
    _check_inertia(robot)
    w = 2.0 * pi * _check_positive(robot, bandwidth, "bandwidth")
    return Gains(w, 2.0 * w * _check_positive(robot, damping, "damping"), FILTER_TIME / w)


def check_step(found: Gains, step: float) -> None:
    """Raise InvalidInput if the servos are too fast for the step of the plant."""
    fastest = float(np.maximum(found.frequency, found.damping).max())
    if fastest * step > FASTEST_GAIN:
        wanted = f"gains of at most {FASTEST_GAIN / step:.0f} 1/s at steps of {1000.0 * step:g} ms, or a smaller step"
        raise InvalidInput("bandwidth, damping", f"a gain (ω, 2 ζ ω) of {fastest:.0f} 1/s", wanted)


def _check_inertia(robot: Robot) -> None:
    """Raise InvalidInput if a joint moves no mass."""
    low, high = np.maximum(robot.limits.lower, -FULL_TURN), np.minimum(robot.limits.upper, FULL_TURN)
    low, high = np.minimum(low, high), np.maximum(low, high)  # limits that begin beyond a turn
    M = robot.mass_matrix(np.random.default_rng(0).uniform(low, high, (EXAMINED, robot.n)))
    if not (np.linalg.eigvalsh(M) > 0.0).all():
        inertia = np.diagonal(M, axis1=1, axis2=2).max(axis=0)
        joint = robot.joint_names[int(inertia.argmin())]
        raise InvalidInput(
            "robot", f"{robot.name!r}, whose joint {joint} moves no mass", "masses, or inertia of the motors"
        )


def _check_positive(robot: Robot, value: ArrayLike, argument: str) -> Array:
    """Return one number above 0 for each joint."""
    wanted = f"a finite number above 0, or {robot.n} of them"
    array = real_array(value, argument, wanted)
    if array.shape not in ((), (robot.n,)) or not (np.isfinite(array) & (array > 0.0)).all():
        raise InvalidInput(argument, repr(value)[:60], wanted)
    return np.broadcast_to(array, (robot.n,)).copy()


POSITION_GAIN, VELOCITY_GAIN, NEW_WEIGHT, COUNT, FARTHEST_OFF, MOST_TORQUE = range(6)
"""Rows of the parameters of `servo`: position gain [1/s²], velocity gain [1/s], weight of a new difference in the filtered
velocity [1], resolution of the encoder [rad, m] (0 for an exact one), position error at which the motor is switched off
[rad, m], and largest torque [N·m, N]."""


def pack_gains(found: Gains, step: float, resolution: Array, following: Array, most: Array) -> Array:
    """Return the parameters of `servo` in one array, because each array costs 0.2 µs at every step."""
    weight = step / (found.filter + step)
    return np.array([found.frequency**2, found.damping, weight, resolution, following, most])


@compiled
def servo(tuned: Array, M: Array, setpoint: Array, position: Array, state: Array, step: float, torque: Array) -> None:
    """Compute the torques of the motors for one step of the plant.

    The measured velocity is the difference of two encoder readings over the step. The difference of commanded and measured
    velocity is filtered. A motor is switched off for good when its joint is too far from its set-point.

    Shapes and units (revolute joints): tuned (6, n), M (n, n) [kg·m²], setpoint (3, n) [rad, rad/s, N·m], position (n,) [rad],
    state (4, n) [rad, rad/s, 1, rad/s²], step [s], torque (n,) [N·m] (overwritten).
    """
    n = position.size
    for i in range(n):
        counts = tuned[COUNT, i]
        read = np.round(position[i] / counts) * counts if counts > 0.0 else position[i]
        state[3, i] = 0.0
        if read == read:  # no NaN
            difference = setpoint[1, i] - (read - state[0, i]) / step
            if difference != difference:  # the encoder is back
                difference = 0.0
            state[1, i] += tuned[NEW_WEIGHT, i] * (difference - state[1, i])
            if abs(setpoint[0, i] - read) > tuned[FARTHEST_OFF, i]:
                state[2, i] = 1.0
            if state[2, i] == 0.0:
                error = setpoint[0, i] - read
                state[3, i] = tuned[POSITION_GAIN, i] * error + tuned[VELOCITY_GAIN, i] * state[1, i]
        else:
            state[1, i] = 0.0
        state[0, i] = read
    for i in range(n):
        wanted, most = setpoint[2, i], tuned[MOST_TORQUE, i]
        for j in range(n):
            wanted += M[i, j] * state[3, j]
        torque[i] = min(max(wanted, -most), most) if state[2, i] == 0.0 else 0.0
