"""A configuration at which work with an arm can begin: where no home is known, as of an arm from a URDF."""

from __future__ import annotations

import numpy as np

from optik.arm.limits import JointLimits
from optik.arm.model import unit_factors
from optik.arm.robot import Robot
from optik.types import Array

START_SAMPLES = 64
"""Number of random configurations of which the best-conditioned one is the start."""
SHARE = 0.8
"""Part of the ranges, around their middles, from which the start is drawn."""


def choose_start(robot: Robot) -> Array:
    """Choose a start for an arm without a home: always the same one, regular, and away from the ends of the ranges.

    It is the best-conditioned of 64 random configurations within 80 % of the ranges and within ±180°, in whole tenths of
    degrees and millimetres. If the links have shapes, configurations with contact between them are left out.

    Parameters
    ----------
    robot : Robot
        The arm.

    Returns
    -------
    (n,) array
        The configuration [rad, m].
    """
    limits, factors = robot.limits, unit_factors(robot)
    bounded, out = np.isfinite(limits.half), SHARE * limits.half
    low = np.where(bounded, limits.middle - out, limits.lower)
    high = np.where(bounded, limits.middle + out, limits.upper)
    turns = ~robot.prismatic & (low <= np.pi) & (high >= -np.pi)
    low, high = np.where(turns, np.maximum(low, -np.pi), low), np.where(turns, np.minimum(high, np.pi), high)
    drawn = JointLimits(low, high).sample(np.random.default_rng(0), START_SAMPLES)
    q = wind_near(robot, limits.clip(np.round(drawn * factors, 1) / factors), np.zeros(robot.n))
    if robot.shapes is not None and not robot.shapes.unread:
        from optik.scene import Scene
        from optik.scene.contact import find_nearest_pairs

        free = find_nearest_pairs(robot, Scene(), q)[0] > 0.0
        q = q[free] if free.any() else q
    sigma = robot.singular_values(q)
    return np.asarray(q[np.argmax(sigma[:, -1] / sigma[:, 0])])


def wind_near(robot: Robot, q: Array, near: Array) -> Array:
    """Return configurations (..., n) with each joint that turns moved by whole turns, inside its range, nearest to a value."""
    turn, limits = 2.0 * np.pi, robot.limits
    most, least = np.floor((limits.upper - q) / turn), np.ceil((limits.lower - q) / turn)
    turns = np.clip(np.round((near - q) / turn), np.minimum(least, 0.0), np.maximum(most, 0.0))
    return np.asarray(np.where(robot.prismatic, q, q + turn * turns))
