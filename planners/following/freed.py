"""The freed arm: for a path of which less than the pose is asked, a joint behind the tool for each free rotation.

The joints behind the tool take up what is not asked. So six rows with these joints are the asked rows of the arm alone: a
motion of the freed arm along the path is one of the arm that meets what is asked, and nothing else.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.ik import Tolerance
from optik.types import Array
from planners.following.failure import RANK_DRAWS, ZERO_FRACTION, FollowStatus, PlanFailure, find_rank, format_position
from planners.following.resolve.freedoms import add_joints
from planners.paths.base import Path
from planners.paths.points import PointsOf

PLANE_SAMPLES = 401
"""Points of a path that are compared with what an arm's point can reach without leaving a plane or a line."""
FREE = -np.inf, np.inf
"""Range of a free rotation [rad]."""
WORDS = {"axis": "the tool's point and axis are", "point": "only the tool's point is"}
"""What is asked of an arm, in words."""
POINT_ADVICE = "free(path, turn=True, tilt=True), which asks the tool's point alone; or "
"""Begin of the advice where more is asked than an arm can follow."""


class FreedArm(NamedTuple):
    """An arm with joints behind its tool, the path of its last frame, and its configuration at the start."""

    robot: Robot
    path: Path
    q: Array | None

    def allow(self, tolerance: Tolerance) -> Tolerance:
        """Return the tolerance of the last frame, whose rotation does not count where only the point is asked."""
        return replace(tolerance, rotation=np.pi) if isinstance(self.path, PointsOf) else tolerance


def find_distance(robot: Robot, q: Array, path: Path) -> tuple[float, float]:
    """Return how far a configuration is from what is asked at the path's start [m, rad]."""
    target = path.pose(0.0)
    off = robot.pose_errors(q, target)
    angle = float(np.linalg.norm(off[3:])) if path.asked == "pose" else 0.0
    if path.asked == "axis":
        apart = float(np.linalg.norm(robot.fk(q)[:3, 2] - target[:3, 2]))
        angle = 2.0 * float(np.arcsin(min(0.5 * apart, 1.0)))
    return float(np.linalg.norm(off[:3])), angle


def free_arm(own: Robot, path: Path, q: Array | None, tolerance: float) -> FreedArm:
    """Return the freed arm for a path, whose own joints come first."""
    start = path.pose(0.0)[:3, :3]
    R = start if q is None else own.fk(q)[:3, :3]
    if path.asked == "axis":
        arm, D = _with_turn(own), start.T @ R
        turn = np.arctan2(D[1, 0] - D[0, 1], D[0, 0] + D[1, 1])
        return FreedArm(arm, path, q if q is None or arm is own else np.append(q, turn))
    still = _find_still(own)[1]
    joints = [(f"free{i + 1}", np.append(np.zeros(3), axis), FREE) for i, axis in enumerate(_choose_axes(own, q))]
    joints += [("slide", np.append(R.T @ n, np.zeros(3)), (-tolerance, tolerance)) for n in still]
    arm = replace(add_joints(own, joints), name=own.name)
    return FreedArm(arm, PointsOf(path, R), None if q is None else np.append(q, np.zeros(len(joints))))


@lru_cache(maxsize=16)
def _with_turn(own: Robot) -> Robot:
    """Return the arm with a turn about the tool's axis, unless its own last joint turns the tool about that."""
    arm = replace(add_joints(own, [("turn", np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), FREE)]), name=own.name)
    return arm if find_rank(arm) == arm.n else own


def _choose_axes(own: Robot, q: Array | None) -> Array:
    """Return three axes (3, 3) in the tool's frame, one in each row; the arm turns its tool the least about the middle one.

    A quarter turn about that one makes the three free rotations singular.
    """
    at = own.limits.sample(np.random.default_rng(0), RANK_DRAWS) if q is None else q[None]
    turns = np.swapaxes(own.fk(at)[:, :3, :3], 1, 2) @ own.jacobian(at)[:, 3:]
    axes = np.linalg.svd(np.concatenate(list(turns), axis=1))[0].T
    return axes[[0, 2, 1]]


@lru_cache(maxsize=16)
def _find_still(own: Robot) -> tuple[int, Array]:
    """Return in how many directions the joints move the point, and those (k, 3) of the base frame in which none ever does."""
    J = own.jacobian(own.limits.sample(np.random.default_rng(0), RANK_DRAWS))[:, :3]
    each, (axes, all_of, _) = np.linalg.svd(J, compute_uv=False), np.linalg.svd(np.concatenate(list(J), axis=1))
    least = ZERO_FRACTION * all_of[0]
    return int((each > least).sum(axis=1).max()), np.ascontiguousarray(axes[:, all_of <= least].T)


def find_immovable(own: Robot, path: Path, tolerance: float) -> PlanFailure | None:
    """Return the failure of an arm whose point cannot move as a path asks, or None."""
    if path.asked != "point":
        return None
    rank, still = _find_still(own)
    if rank + len(still) < 3:
        reason = f"the joints of {own.name} move its tool's point in {rank} directions only, neither a plane nor a line"
        return PlanFailure(FollowStatus.SINGULAR, 0.0, None, reason, "a path in the joints, such as JointLine", 0.0)
    if not len(still):
        return None
    s = np.linspace(0.0, path.end, PLANE_SAMPLES)
    off = np.linalg.norm((path.pose(s)[:, :3, 3] - own.fk(own.limits.middle)[:3, 3]) @ still.T, axis=1)
    if off.max() <= tolerance:
        return None
    k, where = int(np.argmax(off > tolerance)), "a plane" if len(still) == 1 else "a line"
    reason = f"{own.name} moves its tool's point in {where} only, and the path is {1e3 * off.max():.3g} mm beside it"
    reason += f", from {format_position(path, s[k])} on" if k else ""
    return PlanFailure(FollowStatus.UNREACHABLE, float(s[k]), None, reason, f"a path in that {where[2:]}")


def explain_asked(failure: PlanFailure, own: Robot, arm: FreedArm, path: Path) -> PlanFailure:
    """Return a failure of the freed arm as one of the arm: its reason says what is asked."""
    reason, advice = f"{failure.reason} ({WORDS[path.asked]} asked)", failure.advice
    if path.asked == "axis":
        last = own.joint_names[-1]
        reason += f"; {last} turns the tool about its axis only, so four joints meet both" if arm.robot is own else ""
        advice = POINT_ADVICE + advice
    return replace(failure, reason=reason, advice=advice)
