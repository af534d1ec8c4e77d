"""Checks of targets and initial guesses, and the initial guesses of restarts."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.check import real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.kinematics import Range
from optik.se3 import check_pose, is_pose
from optik.types import Array


def check_problem(robot: Robot, target: ArrayLike, q0: ArrayLike) -> tuple[Array, Array]:
    """Check a target and an initial guess; valid plain arrays are checked by compiled code, in a tenth of the time."""
    if type(target) is type(q0) is np.ndarray and target.dtype == q0.dtype == np.float64:
        plain = target.shape == (4, 4) and q0.shape == (robot.n,) and target.flags.carray and q0.flags.carray
        limits = robot.limits
        if plain and find_first_invalid(target[None], q0[None], (limits.lower, limits.upper), LIMIT_TOLERANCE) == (
            -1,
            -1,
        ):
            return target, q0
    return check_pose(target, "target"), check_start(robot, q0)


def check_start(robot: Robot, q0: ArrayLike, argument: str = "q0") -> Array:
    """Check that an initial guess is a configuration inside the limits, and return it as an array."""
    q = robot.configuration(q0, argument)
    if not robot.limits.contains(q):
        lower, upper = robot.limits.lower, robot.limits.upper
        i = int(np.argmax(np.maximum(lower - q, q - upper)))
        raise InvalidInput(
            argument,
            f"{robot.joint_names[i]} = {q[i]:.6g}",
            f"every joint inside its limits, here [{lower[i]:.6g}, {upper[i]:.6g}] (rad or m)",
        )
    return q


def check_batch(robot: Robot, targets: ArrayLike, starts: ArrayLike) -> tuple[Array, Array]:
    """Check the targets and initial guesses of a batch, and return them as writeable contiguous arrays."""
    poses = np.ascontiguousarray(real_array(targets, "targets", "poses (N, 4, 4)"))
    if poses.shape == (0,):
        poses = poses.reshape(0, 4, 4)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise InvalidInput("targets", f"shape {poses.shape}", "poses of shape (N, 4, 4)")
    q = real_array(starts, "starts", f"configurations ({len(poses)}, {robot.n}) or ({robot.n},)")
    if q.shape == (0,):
        q = q.reshape(0, robot.n)
    if q.shape not in ((robot.n,), (len(poses), robot.n)):
        wanted = f"shape ({len(poses)}, {robot.n}) or ({robot.n},) for {robot.name}"
        raise InvalidInput("starts", f"shape {q.shape}", wanted)
    limits = robot.limits.lower, robot.limits.upper
    wrong = find_first_invalid(poses, np.atleast_2d(q), limits, LIMIT_TOLERANCE)
    if wrong[0] >= 0:
        check_pose(poses[wrong[0]], f"targets[{wrong[0]}]")
    if wrong[1] >= 0:
        one = q if q.ndim == 1 else q[wrong[1]]
        check_start(robot, one, "starts" if q.ndim == 1 else f"starts[{wrong[1]}]")
    return _copy_if_needed(poses), _copy_if_needed(q) if q.ndim == 2 else np.tile(q, (len(poses), 1))


def _copy_if_needed(array: Array) -> Array:
    """Return the array itself if compiled code can take it, else a contiguous copy."""
    return array if array.flags.c_contiguous and array.flags.writeable else np.array(array, order="C")


@compiled
def find_first_invalid(poses: Array, q: Array, limits: Range, slack: float) -> tuple[int, int]:
    """Return the indices of the first invalid target (N, 4, 4) and initial guess (k, n), −1 if all are valid.

    Shapes and units: poses [1, m], q [rad, m], slack [rad, m].
    """
    lower, upper = limits
    bad_pose, bad_start = -1, -1
    for i in range(poses.shape[0]):
        if not is_pose(poses[i]):
            bad_pose = i
            break
    for i in range(q.shape[0]):
        inside = True
        for j in range(q.shape[1]):
            # an infinite joint value is outside also where the limits are infinite
            inside = inside and lower[j] - slack <= q[i, j] <= upper[j] + slack and abs(q[i, j]) < np.inf
        if not inside:
            bad_start = i
            break
    return bad_pose, bad_start


def sample_restart(robot: Robot, target: Array, q0: Array, restart: int) -> Array:
    """Sample the initial guess of a restart uniformly inside the limits; the problem is the random seed."""
    problem = np.round(np.concatenate([target.ravel(), q0]), 12) + 0.0  # −0 becomes 0: the same number, the same key
    rng = np.random.default_rng((zlib.crc32(problem.tobytes()), restart))
    return np.asarray(robot.limits.sample(rng, 1)[0])
