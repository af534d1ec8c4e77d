"""Targets at the boundary of the workspace: the farthest tool positions in random directions."""

from __future__ import annotations

import numpy as np

from benchmarks.problems.base import random_stream, with_starts
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.types import Array

CLIMBS = 8
"""Searches for the farthest position in one direction, each from a random configuration; the best one counts."""

BOUNDARY_SWEEPS, LEAST_MOVE = 400, 1e-10
"""Sweeps over all joints at most, and the joint motion [rad, m] at which a search ends. The distance that is still missing
then grows with the square of that motion."""


@with_starts
def at_boundary(robot: Robot, seed: int, *, count: int = 200) -> dict[str, Array]:
    """Targets whose positions are the farthest that the tool reaches in random directions, where the arm is stretched.

    For a random unit vector d the tool position p with the largest d·p is found by search: each joint in turn moves to its
    best value, which is known in closed form, until none moves any more; the best of eight searches counts. There the
    position can grow in the direction d only by a motion of joints that are at their limits: the joints that are free do
    not move the tool along d. The target is the tool pose of that configuration. The first problems are the same for any
    larger count.

    Parameters
    ----------
    robot : Robot
        The arm; its prismatic joints must have finite limits.
    seed : int
        Seed of the random draw.
    count : int
        Number of targets.

    Returns
    -------
    dict of (count, n) arrays
        Configurations that reach the targets, one group [rad, m].

    Raises
    ------
    InvalidInput
        A prismatic joint without limits, or a count below 1.
    """
    check_count(count, "count", 1)
    if not np.isfinite(robot.limits.half[robot.prismatic]).all():
        raise InvalidInput("robot", f"{robot.name} with a prismatic joint without limits", "an arm of finite reach")
    d = random_stream(seed, "at_boundary", "directions").normal(size=(count, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    first = robot.limits.sample(random_stream(seed, "at_boundary", "searches"), count * CLIMBS)
    q = _farthest(robot, first, np.repeat(d, CLIMBS, axis=0))
    height = np.einsum("ki,ki->k", robot.fk(q)[:, :3, 3], np.repeat(d, CLIMBS, axis=0)).reshape(count, CLIMBS)
    best = np.ascontiguousarray(q.reshape(count, CLIMBS, robot.n)[np.arange(count), height.argmax(axis=1)])
    return {"at the boundary": best}


def _farthest(robot: Robot, q: Array, d: Array) -> Array:
    """Return configurations (k, n) in which no single joint moves the tool farther along d (k, 3), by coordinate ascent."""
    q = q.copy()
    active = np.arange(len(q))
    for _ in range(BOUNDARY_SWEEPS):
        before = q[active].copy()
        for joint in range(robot.n):
            q[active, joint] = _best_value(robot, q[active], d[active], joint)
        active = active[np.abs(q[active] - before).max(axis=1) > LEAST_MOVE]
        if not active.size:
            break
    return q


def _best_value(robot: Robot, q: Array, d: Array, joint: int) -> Array:
    """Return the value (k,) of one joint inside its limits with the largest d·p: linear if prismatic, else a sinusoid."""
    lower, upper = robot.limits.lower[joint], robot.limits.upper[joint]
    frames = robot.frames(q)
    z = frames[:, joint, :3, 2]
    if robot.prismatic[joint]:
        rise = np.einsum("ki,ki->k", d, z)
        return np.where(rise > 0.0, upper, np.where(rise < 0.0, lower, q[:, joint]))
    r = frames[:, -1, :3, 3] - frames[:, joint, :3, 3]
    across = r - np.einsum("ki,ki->k", r, z)[:, None] * z
    # d·p of the joint turned by x is a constant plus A cos x + B sin x
    A, B = np.einsum("ki,ki->k", d, across), np.einsum("ki,ki->k", d, np.cross(z, r))
    peak = q[:, joint] + np.arctan2(B, A)
    turns = 2.0 * np.pi * np.array([0.0, -1.0, 1.0])
    tried = np.concatenate([peak[:, None] + turns, np.tile([lower, upper], (len(q), 1))], axis=1)
    inside = np.isfinite(tried) & (tried >= lower) & (tried <= upper)
    x = np.where(inside, tried, q[:, [joint]]) - q[:, [joint]]
    value = np.where(inside, A[:, None] * np.cos(x) + B[:, None] * np.sin(x), -np.inf)
    best = tried[np.arange(len(q)), value.argmax(axis=1)]
    # a joint whose motion does not move the tool along d stays where it is
    return np.where(np.hypot(A, B) > 1e-12, best, q[:, joint])


METHOD = at_boundary
