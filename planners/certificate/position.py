"""Whether a motion stays within the position limits of its joints: exact, from the extrema of the polynomials."""

from __future__ import annotations

import numpy as np

from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.types import Array
from planners.certificate.failure import Failure
from planners.trajectory import Trajectory


def position_margins(robot: Robot, trajectory: Trajectory) -> Array:
    """Least distance of every joint to its position limits over a motion.

    Parameters
    ----------
    robot : Robot
        The arm.
    trajectory : Trajectory
        Its motion.

    Returns
    -------
    (n,) array
        Exact margins [rad or m]; negative where a limit is violated.
    """
    reach = trajectory.extrema(0)
    return np.minimum(reach.least - robot.limits.lower, robot.limits.upper - reach.greatest)


def position_failures(margins: Array, joint_names: tuple[str, ...]) -> list[Failure]:
    """The violation of position limits that is the largest.

    Parameters
    ----------
    margins : (n,) array
        What `position_margins` returned [rad or m].
    joint_names : tuple of str
        Names of the joints.

    Returns
    -------
    list of Failure
        Empty where all limits are kept, within 1e-9.
    """
    i = int(np.argmin(margins))
    if margins[i] >= -LIMIT_TOLERANCE:
        return []
    return [
        Failure(f"{joint_names[i]} passes its range by {-margins[i]:.3g} (rad or m)", 0.0, "limits", joint_names[i])
    ]
