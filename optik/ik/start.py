"""A configuration at which work with an arm can begin: where no home is known, as of an arm from a URDF."""

from __future__ import annotations

import numpy as np

from optik.arm.limits import JointLimits
from optik.arm.model import unit_factors
from optik.arm.robot import Robot
from optik.types import Array

START_SAMPLES = 64
"""Number of random configurations among which the start is chosen, in each round."""
ROUNDS = 4
"""Rounds around the best configuration so far, each in half the ranges of the one before."""
SHARE = 0.8
"""Part of the ranges, around their middles, from which the start is drawn."""
STEP, MOST_STEPS = 0.025, 20
"""Step along a line, as a part of the spread of the tool's points, and number of them that is enough."""
DAMPING = 1e-9
"""Added to J Jᵀ, which is singular where a line ends [m²/rad², 1]."""


def choose_start(robot: Robot) -> Array:
    """Choose a start for an arm without a home: always the same one, from which the tool can move in all directions.

    The straight lines along ±x, ±y, ±z of the base from the start, with the tool's orientation unless the arm has fewer than
    six joints, stay inside the ranges. The shortest of the six is the longest among 64 random configurations within 80 % of
    the ranges and within ±180°, and then among 64 around the best, four times. Of equal ones, the best-conditioned is chosen.
    It is in whole tenths of degrees and millimetres. If the links have shapes, configurations with contact between them are
    left out.

    Parameters
    ----------
    robot : Robot
        The arm.

    Returns
    -------
    (n,) array
        The configuration [rad, m].
    """
    limits, factors, rng = robot.limits, unit_factors(robot), np.random.default_rng(0)
    bounded, out = np.isfinite(limits.half), SHARE * limits.half
    low = np.where(bounded, limits.middle - out, limits.lower)
    high = np.where(bounded, limits.middle + out, limits.upper)
    turns = ~robot.prismatic & (low <= np.pi) & (high >= -np.pi)
    room = JointLimits(np.where(turns, np.maximum(low, -np.pi), low), np.where(turns, np.minimum(high, np.pi), high))
    drawn, best = room.sample(rng, START_SAMPLES), np.empty((0, robot.n))
    points = robot.fk(drawn)[:, :3, 3]
    step = STEP * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    half = np.where(np.isfinite(room.half), room.half, np.pi)
    for _ in range(1 + ROUNDS):
        q = wind_near(robot, limits.clip(np.round(drawn * factors, 1) / factors), np.zeros(robot.n))
        q = _keep_free(robot, np.concatenate([best, q]))
        sigma, steps = robot.singular_values(q), count_steps(robot, q, step).min(axis=1)
        best = q[np.lexsort((sigma[:, -1] / sigma[:, 0], steps))[-1:]]
        half = 0.5 * half
        drawn = room.clip(best + half * rng.uniform(-1.0, 1.0, (START_SAMPLES, robot.n)))
    return np.asarray(best[0])


def _keep_free(robot: Robot, q: Array) -> Array:
    """Return the configurations (k, n) without contact between the links; all of them if there is none, or no shapes."""
    if robot.shapes is None or robot.shapes.unread:
        return q
    from optik.scene import Scene
    from optik.scene.contact import find_nearest_pairs

    free = find_nearest_pairs(robot, Scene(), q)[0] > 0.0
    return q[free] if free.any() else q


def count_steps(robot: Robot, q: Array, step: float) -> Array:
    """Return how many steps [m] the tool can go straight along x, y, z, −x, −y, −z from each configuration: (k, 6)."""
    rows, ways = slice(6 if robot.n >= 6 else 3), np.tile(np.concatenate([np.eye(3), -np.eye(3)]), (len(q), 1))
    q, goal, steps = np.repeat(q, 6, axis=0), np.repeat(robot.fk(q), 6, axis=0), np.zeros(6 * len(q))
    going = np.arange(len(q))
    for k in range(MOST_STEPS):
        goal[going, :3, 3] += step * ways[going]
        x = q[going]
        for _ in range(3):
            J = robot.jacobian(x)[:, rows]
            e, JT = robot.pose_errors(x, goal[going])[:, rows, None], np.swapaxes(J, 1, 2)
            x = x + (JT @ np.linalg.solve(J @ JT + DAMPING * np.eye(J.shape[1]), e))[..., 0]
        off = np.linalg.norm(robot.pose_errors(x, goal[going])[:, rows], axis=1)
        q[going] = x
        going = going[(off <= 0.01 * step) & robot.limits.contains(x)]
        steps[going] = k + 1
        if not going.size:
            break
    return steps.reshape(-1, 6)


def wind_near(robot: Robot, q: Array, near: Array) -> Array:
    """Return configurations (..., n) with each joint that turns moved by whole turns, inside its range, nearest to a value."""
    turn, limits = 2.0 * np.pi, robot.limits
    most, least = np.floor((limits.upper - q) / turn), np.ceil((limits.lower - q) / turn)
    turns = np.clip(np.round((near - q) / turn), np.minimum(least, 0.0), np.maximum(most, 0.0))
    return np.asarray(np.where(robot.turning, q + turn * turns, q))
