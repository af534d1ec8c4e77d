"""Position servos of simulated motors: their gains, derived from the arm, and their law at every step of the plant."""

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

BANDWIDTH = 15.0
"""Natural frequency of the servos by default [Hz]: position loops of industrial arms are tuned to 10 to 20 Hz, below the
first resonance of their gears."""

DAMPING = 1.0
"""Damping ratio of the servos by default [1]: no overshoot."""

FILTER_SHARE = 0.4
"""Time constant of the velocity filter, times the natural frequency in rad/s [1]: 4 ms at 15 Hz. One count of an encoder with
20 bits then changes the torque by 0.6 % of what holds the default arm; the damping of the loop falls to 0.8."""

DRAWN = 200
"""Configurations at which the inertia of each joint is looked up: the largest hardly grows beyond."""

FULL_TURN = pi
"""Position limits are cut to this on both sides for it [rad, m]: joints without limits repeat after a turn."""


class Gains(NamedTuple):
    """Gains of the servos, by joint.

    Attributes
    ----------
    stiffness : (n,) array
        Torque per difference of position [N·m/rad, N/m].
    damping : (n,) array
        Torque per difference of velocity [N·m·s/rad, N·s/m].
    frequency : (n,) array
        Natural frequency at the joint's largest inertia [rad/s].
    """

    stiffness: Array
    damping: Array
    frequency: Array


def gains(robot: Robot, bandwidth: ArrayLike, damping: float, stiffness: ArrayLike | None) -> Gains:
    """Derive the gains from the arm: those of a mass of each joint's largest inertia on a spring and a damper.

    Parameters
    ----------
    robot : Robot
        The arm, with masses.
    bandwidth : scalar or (n,) array
        Natural frequency of the joints [Hz].
    damping : float
        Damping ratio [1].
    stiffness : scalar or (n,) array, optional
        Stiffness in place of that of the bandwidth [N·m/rad, N/m].

    Returns
    -------
    Gains
        By joint.

    Raises
    ------
    InvalidInput
        Numbers that are not above 0, or of another number of joints.
    """
    inertia = largest_inertia(robot)
    w = 2.0 * pi * _positive(robot, bandwidth, "bandwidth")
    spring = inertia * w**2
    if stiffness is not None:
        spring = _positive(robot, stiffness, "stiffness")
        w = np.sqrt(spring / inertia)
    ratio = _positive(robot, damping, "damping")
    return Gains(spring, 2.0 * ratio * w * inertia, w)


def largest_inertia(robot: Robot) -> Array:
    """Return the largest inertia that each joint moves, among configurations all over the position limits.

    Parameters
    ----------
    robot : Robot
        The arm, with masses.

    Returns
    -------
    (n,) array
        Diagonal of the mass matrix [kg·m², kg].

    Raises
    ------
    InvalidInput
        A joint that moves no mass.
    """
    low, high = np.maximum(robot.limits.lower, -FULL_TURN), np.minimum(robot.limits.upper, FULL_TURN)
    low, high = np.minimum(low, high), np.maximum(low, high)  # limits that begin beyond a turn
    q = np.random.default_rng(0).uniform(low, high, (DRAWN, robot.n))
    inertia = np.asarray(np.diagonal(robot.mass_matrix(q), axis1=1, axis2=2).max(axis=0))
    if not (inertia > 0.0).all():
        joint = robot.joint_names[int(inertia.argmin())]
        raise InvalidInput("robot", f"{robot.name!r}, whose joint {joint} moves no mass", "a mass or a motor's inertia")
    return inertia


def _positive(robot: Robot, value: ArrayLike, argument: str) -> Array:
    """One number above 0 for each joint."""
    wanted = f"a finite number above 0, or {robot.n} of them"
    array = real_array(value, argument, wanted)
    if array.shape not in ((), (robot.n,)) or not (np.isfinite(array) & (array > 0.0)).all():
        raise InvalidInput(argument, repr(value)[:60], wanted)
    return np.broadcast_to(array, (robot.n,)).copy()


STIFFNESS, DAMPING_ROW, NEW_SHARE, RESOLUTION, FOLLOWING_ROW, MOST = range(6)
"""Rows of a servo's tuning: stiffness [N·m/rad, N/m], damping [N·m·s/rad, N·s/m], share of a new difference in the filtered
velocity [1], resolution of the encoder [rad, m] (0 where exact), difference of position at which the motor is switched off
[rad, m], and largest torque [N·m, N]."""


def tuning(found: Gains, step: float, resolution: Array, following: Array, most: Array) -> Array:
    """Put together what the compiled law takes; one array, as each costs 0.2 µs at every step.

    Parameters
    ----------
    found : Gains
        The gains.
    step : float
        Of the plant [s].
    resolution : (n,) array
        Of the encoders; 0 where exact [rad, m].
    following : (n,) array
        Difference of position at which a motor is switched off [rad, m].
    most : (n,) array
        Largest torques [N·m, N].

    Returns
    -------
    (6, n) array
        By row, as `servo` takes it [as the rows say].
    """
    share = step / (FILTER_SHARE / found.frequency + step)
    return np.array([found.stiffness, found.damping, share, resolution, following, most])


@compiled
def servo(tuned: Array, asked: Array, position: Array, state: Array, step: float, torque: Array) -> None:
    """Torques of the motors for one step of the plant.

    The velocity is the difference of two encoder readings over the step, and so is compared with the difference of two
    commanded positions; what remains is filtered. A motor whose joint is further from its set-point than the servo
    allows is switched off, and stays off.

    Parameters
    ----------
    tuned : (6, n) array
        Of `tuning` [as the rows say].
    asked : (3, n) array
        Commanded positions [rad, m] and velocities [rad/s, m/s], and feed-forward torques [N·m, N].
    position : (n,) array
        Where the encoders are, NaN where one is lost: there, the feed-forward alone acts [rad, m].
    state : (3, n) array
        Last readings [rad, m], filtered differences of velocity [rad/s, m/s], and 1 where a motor is off; changed.
    step : float
        Of the plant [s].
    torque : (n,) array
        Torques of the motors [N·m, N]; overwritten.
    """
    for i in range(position.size):
        counts = tuned[RESOLUTION, i]
        read = np.round(position[i] / counts) * counts if counts > 0.0 else position[i]
        wanted = asked[2, i]
        if read == read:  # no NaN
            difference = asked[1, i] - (read - state[0, i]) / step
            if difference != difference:  # the encoder is back
                difference = 0.0
            state[1, i] += tuned[NEW_SHARE, i] * (difference - state[1, i])
            wanted += tuned[STIFFNESS, i] * (asked[0, i] - read) + tuned[DAMPING_ROW, i] * state[1, i]
            if abs(asked[0, i] - read) > tuned[FOLLOWING_ROW, i]:
                state[2, i] = 1.0
        else:
            state[1, i] = 0.0
        state[0, i] = read
        most = tuned[MOST, i]
        torque[i] = min(max(wanted, -most), most) if state[2, i] == 0.0 else 0.0
