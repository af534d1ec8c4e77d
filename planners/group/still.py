"""A frame that stands still: the joint paths of a chain in which the member with the tool moves alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from optik import se3
from optik.arm.robot import Robot
from optik.types import Array
from planners.following.follow import FollowResult
from planners.following.joint_path import JointPath
from planners.limits.motion_limits import MotionLimits, compute_least_duration

MOST_AXES, ANGLES, TIMED = 2, 8, 2
"""Largest number of joints of a positioner, number of tried angles of its last joint, and number of motions that are timed."""
SAMPLES = 64
"""Positions along the path by which the travel of the joints is measured."""


def list_still(frame: Robot) -> list[Array]:
    """Return the configurations at which a positioner is tried at rest; an empty list for a frame with more than two joints."""
    if frame.n > MOST_AXES:
        return []
    limits = frame.limits
    still = np.tile(np.clip(0.0, limits.lower, limits.upper), (ANGLES, 1))
    ends = np.maximum(limits.lower[-1], -np.pi), np.minimum(limits.upper[-1], np.pi)
    still[:, -1] = np.linspace(*ends, ANGLES, endpoint=ends[1] - ends[0] < 2.0 * np.pi)
    return list(still)


def follow_still(
    chain: Robot, frame: Robot, arm: Robot, still: Sequence[Array], follow: Callable[[Robot], FollowResult],
    limits: MotionLimits,
) -> Iterator[JointPath]:  # fmt: skip
    """Yield joint paths of the chain with the frame still at one of some configurations, those of least travel first."""
    paths = list[tuple[float, JointPath]]()
    for q in still:
        result = follow(arm.with_base(se3.inverse(frame.fk(q))))
        if result and (joints := result.joint_path) is not None:  # else it has a part of the path
            paths.append((_estimate_duration(joints, limits), _hold(chain, joints, q)))
    for _, joints in sorted(paths, key=lambda one: one[0])[:TIMED]:
        yield joints


def _hold(chain: Robot, joints: JointPath, q: Array) -> JointPath:
    """Return the joint path of the chain, whose first joints are those of the frame in reverse order."""
    count, none = len(joints.knots), np.zeros((len(joints.knots), 3, len(q)))
    values = np.hstack([np.tile(q[::-1], (count, 1)), joints.q])
    derivatives = np.concatenate([none, joints.derivatives], axis=2)
    return JointPath(
        chain, joints.path, joints.knots, values, derivatives, joints.ik, np.isin(joints.knots, joints.nodes)
    )


def _estimate_duration(joints: JointPath, limits: MotionLimits) -> float:
    """Return an estimate of the duration [s]: the largest minimum time of any joint for its travel."""
    travel = np.abs(np.diff(joints(np.linspace(0.0, joints.end, SAMPLES)), axis=0)).sum(axis=0)
    return compute_least_duration(travel, limits)
