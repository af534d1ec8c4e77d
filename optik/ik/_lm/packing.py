"""Arm and options in one flat array for the kernels: a joint is a translation, a fixed rotation, and its motion."""

from __future__ import annotations

from functools import lru_cache
from math import atan2, cos, sin, sqrt

import numpy as np

from optik.arm.robot import Robot
from optik.se3 import inverse
from optik.types import Array

# Positions in the flat array. First the options of the search and whether the arm has fewer joints than a pose components,
# then the reach bound (8), rotation (9) and position (3) of the base, rotation (9) and position (3) of the tool, and the
# number of redundant joints.
(AT_TOLERANCE_P, AT_TOLERANCE_R, AT_GAIN, AT_LEAST_DAMPING, AT_ITERATIONS) = range(5)
(AT_FIRST, AT_ATTEMPTS, AT_PATIENCE, AT_PROGRESS, AT_FEW) = range(5, 10)
AT_REACH, AT_BASE_R, AT_BASE_P, AT_TOOL_R, AT_TOOL_P, AT_SPARE = 10, 18, 27, 30, 39, 42

MOST_JOINTS = 12
"""Largest number of joints: the size of the kernels' work arrays."""

# For all joints: p (three values), cos α, sin α, θ, 1 if prismatic, 1 if not locked, lower limit, upper limit.
AT_PX, AT_PY, AT_PZ, AT_COS_A, AT_SIN_A, AT_ZERO, AT_SLIDES, AT_MOVES, AT_LOWER, AT_UPPER = range(43, 163, MOST_JOINTS)

COMPARED_SEEDS, SEEDS = 256, 1024
"""Number of seeds whose poses are compared with the target, and number of all seeds."""
AT_BEST_E, AT_BEST, AT_SEEDS = 163, 164, 176
"""Positions of ½|e|² and of the configuration of the best iterate of earlier attempts, if AT_FIRST is not the first attempt.
Then follow the seeds' poses (13, COMPARED_SEEDS) and configurations (SEEDS, n), first of the seeds anywhere inside the
limits. For arms with redundant joints, those of the seeds with joints at limits follow."""


def pack(robot: Robot, reach: Array, options: Array) -> Array:
    """Return an arm, its reach bound and the options of a solver as one flat array."""
    spare = count_spare_joints(robot)
    joints = np.zeros((10, MOST_JOINTS))
    joints[:, : robot.n] = joint_parameters(robot).T
    first, tool = robot.fixed[0], robot.tool
    frames = (first[:3, :3], first[:3, 3], tool[:3, :3], tool[:3, 3])
    seeds = (*_sample_seeds(robot, 0), *(_sample_seeds(robot, spare) if spare else ()))
    best = np.full(1 + MOST_JOINTS, np.inf)
    parts = (options, reach, *frames, np.array([float(spare)]), joints, best, *seeds)
    return np.concatenate([part.ravel() for part in parts])


def count_spare_joints(robot: Robot) -> int:
    """Return the number of joints that can be held at a limit while six others move."""
    lower, upper = robot.limits.lower, robot.limits.upper
    moves = lower < upper
    limited = moves & (np.isfinite(lower) | np.isfinite(upper))
    return max(min(int(moves.sum()) - 6, int(limited.sum())), 0)


@lru_cache(maxsize=64)
def _sample_seeds(robot: Robot, held: int) -> tuple[Array, Array]:
    """Return poses (13, COMPARED_SEEDS) and configurations (SEEDS, n) of random seeds with `held` joints at a limit.

    A pose is stored so that a scalar product with the target gives half the squared distance up to a constant: rotation
    (9) and position (3), weighted as in the distance, and half the square of the position. A radian counts as 0.3 m
    (measured: values between 0.15 and 0.5 do as well).
    """
    rng = np.random.default_rng(1)
    q = move_to_limits(robot, rng, robot.limits.sample(rng, SEEDS), held)
    T = inverse(robot.fixed[0]) @ robot.fk(q[:COMPARED_SEEDS])
    R, p = T[:, :3, :3] @ robot.tool[:3, :3].T, T[:, :3, 3]
    return np.vstack([0.1 * R.reshape(-1, 9).T, p.T, 0.5 * (p**2).sum(axis=1)]), q


def move_to_limits(robot: Robot, rng: np.random.Generator, q: Array, held: int) -> Array:
    """Move `held` random joints of every configuration to a random finite limit; locked joints stay."""
    lower, upper = robot.limits.lower, robot.limits.upper
    end = np.where(rng.random(q.shape) < 0.5, lower, upper)
    end = np.where(np.isfinite(end), end, np.where(np.isfinite(lower), lower, upper))
    rank = np.where(np.isfinite(end) & (lower < upper), rng.random(q.shape), 2.0).argsort(axis=1).argsort(axis=1)
    return np.where(rank < held, end, q)


def joint_parameters(robot: Robot) -> Array:
    """Return the parameters (n, 10) of an arm's joints.

    Joint frames are rotated about their own z, which only shifts the joint's zero. Joint i then follows joint i − 1 by the
    translation p and Rot(x, α), and Rot(z, q + θ), or Rot(z, θ) Trans(z, q) if prismatic. This describes every serial arm
    with two thirds of the multiplications of full transforms. α and θ are two of the Euler angles z–x–z of the fixed
    rotation; the third is added to θ of the previous joint.
    """
    n, limits = robot.n, robot.limits
    joints = np.zeros((n, 10))
    joints[:, 3] = 1.0  # cos α of the first, whose frame is the base
    joints[:, 6], joints[:, 7] = robot.prismatic, limits.lower < limits.upper
    joints[:, 8], joints[:, 9] = limits.lower, limits.upper
    for i in range(1, n):  # Rot(z, a) Rot(x, α) Rot(z, b): a is added to the previous joint's zero, b to this one's
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
