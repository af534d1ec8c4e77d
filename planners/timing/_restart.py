"""Motions from a moving state: what is left of a motion, a start at exactly a given state, and where one might stop."""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from optik.errors import NoSolution
from planners.follow import JointPath
from planners.hermite import quintic
from planners.timing._ruckig import velocity_control
from planners.timing.base import DERIVATIVES, MotionLimits, PathState
from planners.trajectory import Trajectory

Array = NDArray[np.float64]
State = tuple[Array, Array, Array]

PEAKS = np.array([[1.875, 1.0, 0.1], [5.78, 3.95, 1.0], [60.0, 36.0, 9.0]])
"""Largest velocity, acceleration and jerk of the quintic from a unit of q, q̇ or q̈ to standstill at 0, in unit time."""
LITTLE = 1e-3
"""Share of the jerk limits with which a motion goes over from the given state to its path: it costs no time worth naming."""
STOPS = (1.02, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 6.0)
"""Distances to rest that are tried, over the one that the limits would allow on a straight joint path."""


def _powers(trajectory: Trajectory) -> Array:
    """Coefficients (6, m, n) of a trajectory, also where its degree is lower."""
    c = trajectory.coefficients
    return np.concatenate([np.zeros((6 - len(c), *c.shape[1:])), c])


def _shifted(c: Array, u: Array) -> Array:
    """Coefficients (6, m, n) of the same quintics about u (m,): Horner's scheme, repeated (Taylor's shift)."""
    c, u = c.copy(), u[:, None]
    for last in range(5, 0, -1):
        for i in range(1, last + 1):
            c[i] += u * c[i - 1]
    return c


def rest_of(trajectory: Trajectory, t: float) -> Trajectory:
    """Return what is left of a motion from a time t [s] before its end: the same polynomials, to rounding.

    It begins with exactly the values that the trajectory has at t.
    """
    knots, c = trajectory.knots, _powers(trajectory)
    first = int(np.searchsorted(knots, t, side="right")) - 1
    c = c[:, first:].copy()
    c[:, :1] = _shifted(c[:, :1], np.array([t - knots[first]]))
    for order in range(3):
        c[5 - order, 0] = trajectory(t, order) / factorial(order)
    return Trajectory(PPoly(c, np.append(0.0, knots[first + 1 :] - t), extrapolate=True))


def joined(first: Trajectory, second: Trajectory) -> Trajectory:
    """Return one motion and, from its end on, another."""
    c = np.concatenate([_powers(first), _powers(second)], axis=1)
    return Trajectory(PPoly(c, np.append(first.knots, first.end + second.knots[1:]), extrapolate=True))


def begun(trajectory: Trajectory, start: State, limits: MotionLimits) -> Trajectory:
    """Return the motion begun at exactly q, q̇, q̈ (n,) each, close to its own.

    A path's q(s) meets a measured or refitted state to rounding or noise only. What is missing is added as one quintic
    that ends, with velocity and acceleration, at 0: at the first knot by which its jerk is `LITTLE`, else at the last.
    """
    off = np.array([x - trajectory(0.0, order) for order, x in enumerate(start)])
    knots, c = trajectory.knots, _powers(trajectory).copy()
    jerk = limits.arrays(trajectory.n)["jerk"]
    ends = knots[1:, None]
    peaks = sum(PEAKS[2, i] * np.abs(off[i]) / ends ** (3 - i) for i in range(3)) / jerk
    little = np.flatnonzero(np.max(peaks, axis=1) <= LITTLE)
    count = int(little[0]) + 1 if little.size else knots.size - 1
    still = np.zeros((1, trajectory.n))
    over = quintic(knots[[0, count]], (off[:1], off[1:2], off[2:]), (still, still, still)).c
    c[:, :count] += _shifted(np.repeat(over, count, axis=1), knots[:count])
    for order, x in enumerate(start):
        c[5 - order, 0] = x / factorial(order)
    return Trajectory(PPoly(c, knots, extrapolate=True))


def stopping_places(joint_path: JointPath, limits: MotionLimits, state: PathState) -> list[float]:
    """Places at which a motion might come to rest, from what the limits would allow on a straight joint path."""
    bound = limits.arrays(joint_path.robot.n)
    q1 = np.maximum(np.abs(joint_path(state.s, 1)), 1e-12)
    most, jerk = (float((bound[field] / q1).min()) for field in DERIVATIVES[1:])
    at, v, a = 0.0, state.speed, state.acceleration
    try:
        for h, j in velocity_control((v, a), (0.0, 0.0), most, jerk):
            at, v, a = at + h * (v + h * (0.5 * a + h * j / 6.0)), v + h * (a + 0.5 * h * j), a + h * j
    except NoSolution:  # limits too small for its numbers: the whole path is the one guess left
        at = joint_path.end
    distance = max(at, 1e-6 * joint_path.end)
    places = [state.s + distance * factor for factor in STOPS]
    return [s for s in places if s < joint_path.end] + [joint_path.end]
