"""Torques of a motion at instants, for plots, and the limits on joints; the certificate has the proved bounds."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.dynamics import torques_batch
from optik.types import Array
from planners.limits import DERIVATIVES, LOADED
from planners.trajectory import Trajectory

JOINT_LIMITS = (*DERIVATIVES, *LOADED)
"""Limits on every joint: for each, reports show the largest ratio to it, with its joint and its time."""


def torques_at(robot: Robot, motion: Trajectory, t: Array) -> tuple[Array, Array]:
    """Return torques and their rates at instants."""
    states = np.ascontiguousarray(np.stack([motion(t, order) for order in range(4)], axis=1))
    found = []
    for load in robot.loads:
        out = np.empty((t.size, 2, robot.n))
        torques_batch(robot.chain, load.bodies, load.viscous, states, out)
        out[:, 0] += load.coulomb * np.sign(states[:, 1])
        found.append(out)
    stacked = np.stack(found)
    return stacked[:, :, 0], stacked[:, :, 1]
