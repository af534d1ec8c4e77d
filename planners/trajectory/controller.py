"""The trajectory a controller executes when it interpolates setpoints sent at a fixed rate."""

from __future__ import annotations

import numpy as np
import scipy

from optik.check import check_number
from optik.errors import InvalidInput
from optik.types import Array
from planners.trajectory.curve import quintic_through
from planners.trajectory.trajectory import Trajectory

INTERPOLATIONS = ("linear", "cubic", "quintic")
"""Interpolation through positions; positions and velocities; positions, velocities and accelerations."""
SAME_INSTANT = 1e-9
"""Instants nearer to a knot than this are equal to it [s]: one nanosecond, the resolution of controllers."""
POINTS = 1_000_000
"""Most setpoints of a motion: two hours at 125 per second."""


def simulate_controller(trajectory: Trajectory, rate: float, interpolation: str) -> Trajectory:
    """Return the trajectory a controller executes when it gets setpoints at n / rate and at the end.

    Certify it to see what the arm will do: ``certify(robot, path, simulate_controller(trajectory, 125.0, "cubic"), limits)``.

    Parameters
    ----------
    trajectory : Trajectory
        The motion that is sent. Its exact q, q̇ and q̈ are the points; where q̈ jumps at one, the mean of both sides.
    rate : float
        Points per second [1/s].
    interpolation : str
        ``"linear"`` through positions: velocities jump, so accelerations are infinite. ``"cubic"`` through positions
        and velocities: accelerations jump. ``"quintic"`` through positions, velocities and accelerations.

    Returns
    -------
    Trajectory
        Of the same duration.

    Raises
    ------
    InvalidInput
        A rate that is not above 0 or gives more than 1,000,000 points, or another interpolation.
    """
    if not isinstance(trajectory, Trajectory):
        raise InvalidInput("trajectory", repr(trajectory)[:60], "a Trajectory")
    rate = check_number(rate, "rate", "points per second, above 0", above=0.0)
    periods = trajectory.end * rate
    if periods > POINTS:
        raise InvalidInput("rate", f"{rate:.9g}, {periods:.3g} points", f"at most {POINTS} points")
    t = np.arange(int(periods) + 1) / rate
    t = t[: 1 + np.count_nonzero(t[1:] < trajectory.end - 1e-6 / rate)]  # no period of rounding before the end
    t = np.append(t, trajectory.end)
    return trajectory_through(t, *sample_states(trajectory, t)[: count_derivatives(interpolation)])


def count_derivatives(interpolation: str) -> int:
    """Return the number of derivatives (of q, q̇, q̈) that an interpolation passes through."""
    if not isinstance(interpolation, str) or interpolation not in INTERPOLATIONS:
        raise InvalidInput("interpolation", repr(interpolation)[:60], f"one of {', '.join(INTERPOLATIONS)}")
    return INTERPOLATIONS.index(interpolation) + 1


def sample_states(trajectory: Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """Return q, q̇, q̈ at instants: the mean of both sides, which differ only at a discontinuity."""
    x, c = trajectory.knots, trajectory.coefficients
    sides = []
    for beside in (t - SAME_INSTANT, t + SAME_INSTANT):
        piece = np.clip(np.searchsorted(x, beside, side="right") - 1, 0, x.size - 2)
        u = (t - x[piece])[:, None]
        q = v = a = np.zeros((t.size, trajectory.n))
        for power in c[:, piece]:  # Horner, with both derivatives
            a, v, q = a * u + v, v * u + q, q * u + power
        sides.append((q, v, 2.0 * a))
    q, v, a = (0.5 * (before + after) for before, after in zip(*sides, strict=True))
    return q, v, a


def trajectory_through(t: Array, q: Array, v: Array | None = None, a: Array | None = None) -> Trajectory:
    """Return the motion through setpoints: positions, and velocities and accelerations if they are given."""
    if v is None:
        return Trajectory(scipy.interpolate.PPoly(np.stack([np.diff(q, axis=0) / np.diff(t)[:, None], q[:-1]]), t))
    if a is None:
        return Trajectory(scipy.interpolate.PPoly(scipy.interpolate.CubicHermiteSpline(t, q, v).c, t))
    return Trajectory(quintic_through(t, q, v, a))
