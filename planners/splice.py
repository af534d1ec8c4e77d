"""Cut a motion at a time, join two, append a rest, and match the start of one to a given state exactly."""

from __future__ import annotations

from math import factorial

import numpy as np
import scipy

from optik.types import Array
from planners.curve import quintic
from planners.limits import MotionLimits
from planners.trajectory import Trajectory

State = tuple[Array, Array, Array]
"""q, q̇ and q̈ (n,)."""

PEAKS = np.array([[1.875, 1.0, 0.1], [5.78, 3.95, 1.0], [60.0, 36.0, 9.0]])
"""Largest velocity, acceleration and jerk of the quintic from a unit of q, q̇ or q̈ to standstill at 0, in unit time."""
FADE_FRACTION = 1e-3
"""Fraction of the jerk limits that the correction of the initial state may use: the time lost is negligible."""
SAME_POSITION = 1e-14
"""Largest difference of positions [rad or m] that is rounding."""


def _powers(trajectory: Trajectory) -> Array:
    """Return the coefficients (6, m, n) of a trajectory as quintics."""
    c = trajectory.coefficients
    return np.concatenate([np.zeros((6 - len(c), *c.shape[1:])), c])


def _shift(c: Array, u: Array) -> Array:
    """Return the coefficients (6, m, n) of the same quintics about u (m,), by repeated Horner steps (Taylor shift)."""
    c, u = c.copy(), u[:, None]
    for last in range(5, 0, -1):
        for i in range(1, last + 1):
            c[i] += u * c[i - 1]
    return c


def cut_before(trajectory: Trajectory, t: float, s: float | None = None) -> Trajectory:
    """Return the part of a motion from time t [s] on, with the same polynomials up to rounding.

    It begins with exactly the values of the trajectory at t; `s` is the path parameter there, if it is known.
    """
    knots, c = trajectory.knots, _powers(trajectory)
    first = int(np.searchsorted(knots, t, side="right")) - 1
    c = c[:, first:].copy()
    c[:, :1] = _shift(c[:, :1], np.array([t - knots[first]]))
    for order in range(3):
        c[5 - order, 0] = trajectory(t, order) / factorial(order)
    known = None if s is None or trajectory.s is None else np.append(s, trajectory.s[first + 1 :])
    return Trajectory(scipy.interpolate.PPoly(c, np.append(0.0, knots[first + 1 :] - t), extrapolate=True), known)


def cut_after(trajectory: Trajectory, t: float) -> Trajectory:
    """Return the part of a motion up to time t [s], at most to its end, with the same polynomials."""
    before = int(np.searchsorted(trajectory.knots, t, side="left"))
    knots = np.append(trajectory.knots[:before], t)
    return Trajectory(scipy.interpolate.PPoly(trajectory.coefficients[:, :before], knots, extrapolate=True))


def join(first: Trajectory, second: Trajectory) -> Trajectory:
    """Return one motion followed by another."""
    c = np.concatenate([_powers(first), _powers(second)], axis=1)
    a, b = first.s, second.s
    s = None if a is None or b is None else np.append(a, b[1:])
    return Trajectory(
        scipy.interpolate.PPoly(c, np.append(first.knots, first.end + second.knots[1:]), extrapolate=True), s
    )


def append_rest(trajectory: Trajectory, duration: float) -> Trajectory:
    """Return a motion that ends at rest, prolonged by a time at rest [s]."""
    still = np.zeros((6, 1, trajectory.n))
    still[5] = trajectory(trajectory.end)
    return join(trajectory, Trajectory(scipy.interpolate.PPoly(still, np.array([0.0, duration]))))


def match_start(trajectory: Trajectory, start: State, limits: MotionLimits) -> Trajectory:
    """Return the motion with exactly this start q, q̇, q̈ (n,) each, which is close to its own.

    q(s) differs from a measured or refitted state by noise or rounding. The difference is added as a quintic that fades to 0
    at the first knot at which its jerk is at most `FADE_FRACTION` of the limits, else at the last. A difference of position
    that is rounding is added as a constant: to fade it out over a short time would need jerk.
    """
    off = np.array([x - trajectory(0.0, order) for order, x in enumerate(start)])
    off[0, np.abs(off[0]) <= SAME_POSITION] = 0.0
    knots, c = trajectory.knots, _powers(trajectory).copy()
    jerk = limits.arrays(trajectory.n)["jerk"]
    ends = knots[1:, None]
    peaks = sum(PEAKS[2, i] * np.abs(off[i]) / ends ** (3 - i) for i in range(3)) / jerk
    little = np.flatnonzero(np.max(peaks, axis=1) <= FADE_FRACTION)
    count = int(little[0]) + 1 if little.size else knots.size - 1
    still = np.zeros((1, trajectory.n))
    over = quintic(knots[[0, count]], (off[:1], off[1:2], off[2:]), (still, still, still)).c
    c[:, :count] += _shift(np.repeat(over, count, axis=1), knots[:count])
    c[5] += np.where(off[0] == 0.0, start[0] - trajectory(0.0), 0.0)
    for order, x in enumerate(start):
        c[5 - order, 0] = x / factorial(order)
    return Trajectory(scipy.interpolate.PPoly(c, knots, extrapolate=True), trajectory.s)
