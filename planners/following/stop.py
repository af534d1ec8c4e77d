"""Why following a path ended, in words that are true: what was looked at is what is said."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np

import optik
from optik.arm.reach import outside_reach
from optik.arm.robot import Robot
from optik.ik import IKResult, IKSolver, IKStatus, Tolerance
from optik.types import Array
from planners.following import march
from planners.following.singular import smallest
from planners.following.track import Ended
from planners.paths.base import Path

NEARLY_SINGULAR = 1e-2
"""A branch that ends where the smallest singular value is above this did not end at a singularity."""

BEYOND = 1e-3
"""How far beyond its end [share of the path] the arm is asked whether it reaches there by another configuration."""

EXACT = Tolerance(1e-9, 1e-9)
"""Of whether an arm with fewer than six joints meets a pose: beside a path that it can keep, others are nearly met."""


DRAWN = 20
"""Configurations at which the rank of an arm is looked at; at random ones it is that of almost all."""

ZERO = 1e-10
"""Share of the largest below which a singular value is rounding."""


class FollowStatus(StrEnum):
    """How following a path ended."""

    SOLVED = "solved"
    NO_IK = "no_ik"
    OUTSIDE_LIMITS = "outside_limits"
    BRANCH_JUMP = "branch_jump"
    SINGULAR = "singular"
    UNREACHABLE = "unreachable"


@dataclass(frozen=True)
class Stop:
    """Where and why a motion ended early.

    Attributes
    ----------
    status : StrEnum
        Which kind of end.
    s : float
        Where, in the path's unit.
    joint : str or None
        The joint that says no, where one does.
    reason, advice : str
        With figures; and what would work.
    singular_value : float
        Smallest singular value of the Jacobian at the last good configuration; NaN where there is none.
    """

    status: StrEnum
    s: float
    joint: str | None
    reason: str
    advice: str
    singular_value: float = float("nan")


def unit(robot: Robot, joint: int) -> str:
    """Return m for a sliding joint, rad for one that turns."""
    return "m" if robot.prismatic[joint] else "rad"


@lru_cache(maxsize=16)
def rank_of(robot: Robot) -> int:
    """Greatest rank of the Jacobian at drawn configurations: that of almost all."""
    q = robot.limits.draw(np.random.default_rng(0), DRAWN)
    sigma = robot.singular_values(q)
    return int((sigma > ZERO * sigma[:, :1]).sum(axis=1).max())


def lower_rank(robot: Robot) -> Stop | None:
    """Why an arm follows no path at all: that its joints move the tool in fewer directions than there are of them."""
    rank, full = rank_of(robot), min(robot.n, 6)
    if rank == full:
        return None
    reason = (
        f"the Jacobian of {robot.name} has rank {rank} of {full} at each of {DRAWN} configurations drawn: its {robot.n} joints "
        f"move the tool in {rank} directions only, so a pose does not determine them"
    )
    return Stop(FollowStatus.SINGULAR, 0.0, None, reason, "a path in the joints, such as JointLine", 0.0)


def why_ended(robot: Robot, path: Path, reach: Array, ended: Ended, q: Array) -> Stop:
    """Say why the branch ended, from its last good configuration q (n,) and from what lies beyond on the path."""
    sigma, s = smallest(robot, q), ended.s
    if ended.code == march.LIMIT:
        i, name = ended.joint, robot.joint_names[ended.joint]
        low, high = robot.limits.lower[i], robot.limits.upper[i]
        reason = f"{name} comes to the end of its range [{low:.6g}, {high:.6g}] {unit(robot, i)} at s = {s:.6g}"
        return Stop(FollowStatus.OUTSIDE_LIMITS, s, name, reason, "", sigma)
    status, reason = _beyond(robot, path, reach, ended, q, sigma)
    return Stop(status, s, None, f"{reason}; smallest singular value {sigma:.2g}", "", sigma)


def _beyond(robot: Robot, path: Path, reach: Array, ended: Ended, q: Array, sigma: float) -> tuple[FollowStatus, str]:
    """Status and reason of an end that is not at a limit: what the arm can do just beyond it."""
    s = ended.s
    beyond = path.pose(min(s + BEYOND * path.end, path.end))
    distance = outside_reach(reach, beyond, 0.0, 0.0)
    if distance >= 0.0:
        bound = f"at most {reach[7]:.6g}" if distance > reach[7] else f"at least {reach[6]:.6g}"
        return FollowStatus.UNREACHABLE, (
            f"the path leaves the arm's reach at s = {s:.6g}: just beyond it asks for {distance:.6g} m between the first "
            f"and the last joint's axis, where the links allow {bound} m"
        )
    if robot.n < 6 and ended.code == march.NOT_MET and sigma > NEARLY_SINGULAR:
        few = f"{robot.name} has {robot.n} joints and cannot keep to this path from s = {s:.6g} on"
        target = path.pose(min(s + 10.0 * BEYOND * path.end, path.end))
        near = optik.solve_ik(robot, target, robot.limits.clip(q), tolerance=EXACT)
        if near:
            return FollowStatus.BRANCH_JUMP, f"{few} without a jump to another configuration"
        off = f"{1e3 * near.position_error:.3g} mm and {np.degrees(near.rotation_error):.3g}° off"
        return FollowStatus.UNREACHABLE, f"{few}: a little further it stays {off}"
    result = optik.solve_ik(robot, beyond, robot.limits.clip(q))
    this = "this branch" if robot.n <= 6 else "this choice of its free motion"
    if result and sigma > NEARLY_SINGULAR:
        words = f"no continuous motion goes on at s = {s:.6g}, where the arm is not singular: does the path jump there?"
        return FollowStatus.BRANCH_JUMP, words
    close = f": the smallest singular value comes to {march.SMALLEST_SINGULAR_VALUE:g} or below"
    singular = f"the arm is singular at s = {s:.6g}{close if ended.code == march.SINGULAR else f', {this} ends there'}"
    if result:
        return FollowStatus.SINGULAR, f"{singular}; just beyond, another configuration meets the path"
    if result.status is IKStatus.OUTSIDE_LIMITS:
        return FollowStatus.SINGULAR, f"{singular}; just beyond, the path was met only with joints outside their limits"
    return FollowStatus.UNREACHABLE, (
        f"the path leaves what the arm reaches at s = {s:.6g}: no configuration was found just beyond, from "
        f"{result.restarts + 1} starts"
    )


def no_ik(solver: IKSolver, s: float, result: IKResult, before: Array) -> Stop:
    """The method failed where the arm can go on."""
    sigma = smallest(solver.robot, before)
    reason = (
        f"{solver.name} found no configuration at s = {s:.6g} ({result.status}: {1e3 * result.position_error:.3g} mm and "
        f"{np.degrees(result.rotation_error):.3g}° away), where the branch goes on; smallest singular value {sigma:.2g}"
    )
    return Stop(FollowStatus.NO_IK, s, None, reason, f"another method, such as lm; {result.status.advice}", sigma)


def jumped(solver: IKSolver, s: float, step: Array, before: Array) -> Stop:
    """The method went over to another configuration."""
    robot, i = solver.robot, int(np.argmax(np.abs(step)))
    name = robot.joint_names[i]
    reason = (
        f"{solver.name} jumps to another configuration at s = {s:.6g}: {name} stands {step[i]:.3g} {unit(robot, i)} away "
        "from where the motion leads"
    )
    advice = "another method, such as lm, or more samples: the branch itself goes on there"
    return Stop(FollowStatus.BRANCH_JUMP, s, name, reason, advice, smallest(robot, before))
