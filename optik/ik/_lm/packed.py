"""The arm as the kernels take it: every joint a translation, one fixed angle about x, then its own motion about z."""

from __future__ import annotations

from functools import lru_cache
from math import atan2, cos, sin, sqrt

import numpy as np

from optik.arm.robot import Robot
from optik.se3 import inverse
from optik.types import Array

# Where things stand in the one flat array that the kernels take: options, reach bound (8), base rotation (9) and position
# (3), tool rotation (9) and position (3), joints to spare, the joints, the seeds' poses (13, NEAR) and configurations
# (SEEDS, n); where joints are to spare, both once more for the seeds on the limits.
TOLERANCE_P, TOLERANCE_R, GAIN, LEAST_DAMPING, ITERATIONS, FIRST, ATTEMPTS, PATIENCE, PROGRESS = range(9)
REACH, BASE_R, BASE_P, TOOL_R, TOOL_P, SPARE = 9, 17, 26, 29, 38, 41
MOST_JOINTS = 12
# Of all joints each: p (three of them), cos α, sin α, θ, 1 if it slides, 1 if it can move, its lower and upper limit.
PX, PY, PZ, COS_A, SIN_A, ZERO, SLIDES, MOVES, LOWER, UPPER = range(42, 162, MOST_JOINTS)

NEAR, SEEDS = 256, 1024
"""Seeds whose poses are compared with the target, and seeds in all."""

SEED_POSES = 162


def pack(robot: Robot, reach: Array, options: Array) -> Array:
    """Put an arm, its reach bound and the options of a solver into one flat array."""
    spare = spare_joints(robot)
    joints = np.zeros((10, MOST_JOINTS))
    joints[:, : robot.n] = chain_joints(robot).T
    first, tool = robot.fixed[0], robot.tool
    frames = (first[:3, :3], first[:3, 3], tool[:3, :3], tool[:3, 3])
    seeds = (*_seeds(robot, 0), *(_seeds(robot, spare) if spare else ()))
    parts = (options, reach, *frames, np.array([float(spare)]), joints, *seeds)
    return np.concatenate([part.ravel() for part in parts])


def spare_joints(robot: Robot) -> int:
    """How many joints can be held at a limit while six others still move."""
    lower, upper = robot.limits.lower, robot.limits.upper
    moves = lower < upper
    limited = moves & (np.isfinite(lower) | np.isfinite(upper))
    return max(min(int(moves.sum()) - 6, int(limited.sum())), 0)


@lru_cache(maxsize=64)
def _seeds(robot: Robot, held: int) -> tuple[Array, Array]:
    """Return what the search reads of the seeds' poses (13, NEAR), and the seeds (SEEDS, n), drawn inside the limits.

    Of each so many joints stand at a limit, the others inside.

    The rows are rotation (9) and position (3), weighted as the distance between poses counts them, and half the square
    of the position: half the squared distance to a target is that minus a scalar product, up to a constant. A radian
    counts as 0.3 m (measured: anything between 0.15 and 0.5 does as well).
    """
    rng = np.random.default_rng(1)
    q = on_limits(robot, rng, robot.limits.draw(rng, SEEDS), held)
    T = inverse(robot.fixed[0]) @ robot.fk(q[:NEAR])
    R, p = T[:, :3, :3] @ robot.tool[:3, :3].T, T[:, :3, 3]
    return np.vstack([0.1 * R.reshape(-1, 9).T, p.T, 0.5 * (p**2).sum(axis=1)]), q


def on_limits(robot: Robot, rng: np.random.Generator, q: Array, held: int) -> Array:
    """Put so many joints of every configuration (k, n) at a limit, both drawn: a finite one, of a joint that moves."""
    lower, upper = robot.limits.lower, robot.limits.upper
    end = np.where(rng.random(q.shape) < 0.5, lower, upper)
    end = np.where(np.isfinite(end), end, np.where(np.isfinite(lower), lower, upper))
    rank = np.where(np.isfinite(end) & (lower < upper), rng.random(q.shape), 2.0).argsort(axis=1).argsort(axis=1)
    return np.where(rank < held, end, q)


def chain_joints(robot: Robot) -> Array:
    """Return the numbers of an arm's joints, (n, 10).

    Frames are turned about their own z, which only shifts a joint's zero, so that joint i is reached from joint i − 1 by
    the translation p and Rot(x, α), then Rot(z, q + θ), or Rot(z, θ) Trans(z, q) if it slides: any serial arm, in two
    thirds of the multiplications of a full transform. α and θ are two of the Euler angles z–x–z of the fixed rotation;
    the third goes to the joint before.
    """
    n, limits = robot.n, robot.limits
    joints = np.zeros((n, 10))
    joints[:, 3] = 1.0  # cos α of the first, whose frame is the base
    joints[:, 6], joints[:, 7] = robot.prismatic, limits.lower < limits.upper
    joints[:, 8], joints[:, 9] = limits.lower, limits.upper
    for i in range(1, n):  # Rot(z, a) Rot(x, α) Rot(z, b): a goes to the zero of the joint before, b to this one's
        R, p = robot.fixed[i, :3, :3], robot.fixed[i, :3, 3]
        across = sqrt(R[0, 2] ** 2 + R[1, 2] ** 2)
        a = atan2(R[0, 2], -R[1, 2]) if across > 1e-12 else 0.0
        ca, sa = cos(a), sin(a)
        ct, st = R[2, 2], sa * R[0, 2] - ca * R[1, 2]
        size = sqrt(ct * ct + st * st)
        ct, st = ct / size, st / size
        back = np.array([[ca, sa, 0.0], [-ct * sa, ct * ca, st], [st * sa, -st * ca, ct]])  # Rot(x, −α) Rot(z, −a)
        rest = back @ R
        joints[i, 0:3] = ca * p[0] + sa * p[1], ca * p[1] - sa * p[0], p[2]
        joints[i, 3:5] = ct, st
        joints[i - 1, 5] += a
        joints[i, 5] = atan2(rest[1, 0], rest[0, 0])
    return joints
