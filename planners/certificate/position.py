"""Distances of a motion to the position limits of its joints: exact, from the extrema of the polynomials."""

from __future__ import annotations

import numpy as np

from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.types import Array
from planners.certificate.violation import Violation
from planners.trajectory import Trajectory


def position_margins(robot: Robot, trajectory: Trajectory) -> Array:
    """Return the least distance of every joint to its position limits over a motion."""
    reach = trajectory.extrema(0)
    return np.minimum(reach.least - robot.limits.lower, robot.limits.upper - reach.greatest)


def position_times(robot: Robot, trajectory: Trajectory) -> Array:
    """Return the times at which the joints are nearest to their position limits (n,) [s]."""
    reach = trajectory.extrema(0)
    lower = reach.least - robot.limits.lower < robot.limits.upper - reach.greatest
    return np.where(lower, reach.t_least, reach.t_greatest)


def find_position_violations(
    margins: Array, joint_names: tuple[str, ...], times: Array | None = None
) -> list[Violation]:
    """Return the largest violation of a position limit above 1e-9, from the margins and their times."""
    i = int(np.argmin(margins))
    if margins[i] >= -LIMIT_TOLERANCE:
        return []
    t = 0.0 if times is None else float(times[i])
    words = f"{joint_names[i]} exceeds its range by {-margins[i]:.3g} (rad or m) at t = {t:.6g} s"
    return [Violation(words, t, "limits", joint_names[i])]
