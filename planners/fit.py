"""Scale a motion in time until it just keeps its limits: the same path, uniformly slower or faster."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from planners.certificate.tool_speed import tool_speed
from planners.limits import ALL_LIMITS, DERIVATIVES, TOOL_SPEEDS, MotionLimits
from planners.trajectory import Trajectory


def stretch(robot: Robot, trajectory: Trajectory, limits: MotionLimits, keeps: tuple[str, ...] = ALL_LIMITS) -> float:
    """Least factor by which a motion from rest to rest is stretched in time so that its exact extrema keep the limits.

    Parameters
    ----------
    robot : Robot
        The arm.
    trajectory : Trajectory
        From rest to rest.
    limits : MotionLimits
        What it shall keep.
    keeps : tuple of str
        Which of them.

    Returns
    -------
    float
        Below 1 where the motion leaves room; 0 where nothing limits it.
    """
    bound, factor = limits.arrays(robot.n), 0.0
    for order, field in enumerate(DERIVATIVES, start=1):
        if field in keeps:
            ratio = float((trajectory.piece_worst(order) / bound[field]).max())
            # a root may round down to 1 what is above it
            factor = max(factor, ratio ** (1.0 / order), np.nextafter(1.0, 2.0) if ratio > 1.0 else 0.0)
    if any(np.isfinite(limit) and field in keeps for field, limit in zip(TOOL_SPEEDS, limits.tool, strict=True)):
        speeds = tool_speed(robot, trajectory)
        for field, limit, speed in zip(TOOL_SPEEDS, limits.tool, (speeds.speed, speeds.rotation), strict=True):
            if field in keeps:
                factor = max(factor, speed / limit)
    return factor


def fitted(
    robot: Robot, trajectory: Trajectory, limits: MotionLimits, keeps: tuple[str, ...] = ALL_LIMITS
) -> Trajectory:
    """Return a motion from rest to rest, scaled in time so that it just keeps its limits, and not a bit more."""
    factor = stretch(robot, trajectory, limits, keeps)
    if not factor > 0.0:
        return trajectory
    trajectory = trajectory.slowed(factor)
    margin = 1e-12
    while (factor := stretch(robot, trajectory, limits, keeps)) > 1.0:  # rounding in the scaled motion may still exceed
        trajectory = trajectory.slowed(factor * (1.0 + margin))
        margin *= 10.0
    return trajectory
