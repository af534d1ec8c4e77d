"""Why following a path ended: each reason states what was checked."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Self

import numpy as np

import optik
from optik.arm.reach import outside_reach
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.ik import IKResult, IKSolver, IKStatus, Tolerance
from optik.types import Array
from planners.following import march
from planners.following.singular import smallest_singular_value
from planners.following.track import TrackEnd
from planners.paths.base import Path

CLEARLY_REGULAR = 1e-2
"""A branch that ends where the smallest singular value is above this did not end at a singular configuration."""

BEYOND = 1e-3
"""Distance [share of the path] behind its end at which other configurations of the arm are searched."""

EXACT_TOLERANCE = Tolerance(1e-9, 1e-9)
"""Tolerance [m, rad] of whether an arm with fewer than six joints meets a pose: it nearly meets many that it cannot meet."""


RANK_DRAWS = 20
"""Random configurations at which the rank of an arm is computed; almost all configurations have the same."""

ZERO_FRACTION = 1e-10
"""A singular value below this share of the largest is rounding."""


class FollowStatus(StrEnum):
    """How following a path ended."""

    SOLVED = "solved"
    NO_IK = "no_ik"
    OUTSIDE_LIMITS = "outside_limits"
    BRANCH_JUMP = "branch_jump"
    SINGULAR = "singular"
    UNREACHABLE = "unreachable"
    CONTACT = "contact"


@dataclass(frozen=True)
class PlanFailure:
    """Where and why a motion ended early.

    Attributes
    ----------
    status : StrEnum
        How it ended.
    s : float
        Where [m, or rad].
    joint : str or None
        Joint whose limit is violated, or None.
    reason, advice : str
        Why, with figures; and what would work.
    singular_value : float
        Smallest singular value of the Jacobian at the last good configuration; NaN where there is none.
    """

    status: StrEnum
    s: float
    joint: str | None
    reason: str
    advice: str
    singular_value: float = float("nan")

    @classmethod
    def from_error(cls, status: StrEnum, error: NoSolution) -> Self:
        """Return the failure that an error describes.

        Parameters
        ----------
        status : StrEnum
            The status of the plan.
        error : NoSolution
            The error.

        Returns
        -------
        PlanFailure
            The failure.
        """
        return cls(status, error.s or 0.0, error.joint, error.reason, error.advice)

    def to_error(self) -> NoSolution:
        """Return the error that describes this failure."""
        return NoSolution(self.reason, s=self.s, joint=self.joint, advice=self.advice)


def joint_unit(robot: Robot, joint: int) -> str:
    """Return the unit of a joint."""
    return "m" if robot.prismatic[joint] else "rad"


@lru_cache(maxsize=16)
def find_rank(robot: Robot) -> int:
    """Return the greatest rank of the Jacobian at random configurations, which is that of almost all."""
    q = robot.limits.sample(np.random.default_rng(0), RANK_DRAWS)
    sigma = robot.singular_values(q)
    return int((sigma > ZERO_FRACTION * sigma[:, :1]).sum(axis=1).max())


def find_rank_failure(robot: Robot) -> PlanFailure | None:
    """Explain why an arm follows no Cartesian path at all: the rank of its Jacobian is deficient everywhere."""
    rank, full = find_rank(robot), min(robot.n, 6)
    if rank == full:
        return None
    reason = (
        f"the Jacobian of {robot.name} has rank {rank} of {full} at each of {RANK_DRAWS} configurations drawn: its {robot.n} "
        f"joints move the tool in {rank} directions only, so a pose does not determine them"
    )
    return PlanFailure(FollowStatus.SINGULAR, 0.0, None, reason, "a path in the joints, such as JointLine", 0.0)


def explain_end(robot: Robot, path: Path, reach: Array, ended: TrackEnd, q: Array) -> PlanFailure:
    """Explain why a branch ended, by its last good configuration and by the path just behind the end."""
    sigma, s = smallest_singular_value(robot, q), ended.s
    if ended.code == march.LIMIT:
        i, name = ended.joint, robot.joint_names[ended.joint]
        low, high = robot.limits.lower[i], robot.limits.upper[i]
        reason = f"{name} comes to the end of its range [{low:.6g}, {high:.6g}] {joint_unit(robot, i)} at s = {s:.6g}"
        return PlanFailure(FollowStatus.OUTSIDE_LIMITS, s, name, reason, "", sigma)
    status, reason = _explain_beyond(robot, path, reach, ended, q, sigma)
    return PlanFailure(status, s, None, f"{reason}; smallest singular value {sigma:.2g}", "", sigma)


def _explain_beyond(
    robot: Robot, path: Path, reach: Array, ended: TrackEnd, q: Array, sigma: float
) -> tuple[FollowStatus, str]:
    """Status and reason of an end that is not at a limit, by what the arm can do just behind it."""
    s = ended.s
    beyond = path.pose(min(s + BEYOND * path.end, path.end))
    distance = outside_reach(reach, beyond, 0.0, 0.0)
    if distance >= 0.0:
        bound = f"at most {reach[7]:.6g}" if distance > reach[7] else f"at least {reach[6]:.6g}"
        return FollowStatus.UNREACHABLE, (
            f"the path leaves the arm's reach at s = {s:.6g}: just beyond it asks for {distance:.6g} m between the first "
            f"and the last joint's axis, where the links allow {bound} m"
        )
    if robot.n < 6 and ended.code == march.NOT_MET and sigma > CLEARLY_REGULAR:
        few = f"{robot.name} has {robot.n} joints and cannot keep to this path from s = {s:.6g} on"
        target = path.pose(min(s + 10.0 * BEYOND * path.end, path.end))
        near = optik.solve_ik(robot, target, robot.limits.clip(q), tolerance=EXACT_TOLERANCE)
        if near:
            return FollowStatus.BRANCH_JUMP, f"{few} without a jump to another configuration"
        off = f"{1e3 * near.position_error:.3g} mm and {np.degrees(near.rotation_error):.3g}° off"
        return FollowStatus.UNREACHABLE, f"{few}: a little further it stays {off}"
    result = optik.solve_ik(robot, beyond, robot.limits.clip(q))
    this = "this branch" if robot.n <= 6 else "this choice of its free motion"
    if result and sigma > CLEARLY_REGULAR:
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


def explain_ik_failure(solver: IKSolver, s: float, result: IKResult, before: Array) -> PlanFailure:
    """Explain that the IK method failed where the branch continues."""
    sigma = smallest_singular_value(solver.robot, before)
    reason = (
        f"{solver.name} found no configuration at s = {s:.6g} ({result.status}: {1e3 * result.position_error:.3g} mm and "
        f"{np.degrees(result.rotation_error):.3g}° away), where the branch goes on; smallest singular value {sigma:.2g}"
    )
    return PlanFailure(
        FollowStatus.NO_IK, s, None, reason, f"another method, such as lm; {result.status.advice}", sigma
    )


def explain_branch_jump(solver: IKSolver, s: float, step: Array, before: Array) -> PlanFailure:
    """Explain that the IK method converged to another branch."""
    robot, i = solver.robot, int(np.argmax(np.abs(step)))
    name = robot.joint_names[i]
    reason = (
        f"{solver.name} jumps to another configuration at s = {s:.6g}: {name} is {step[i]:.3g} {joint_unit(robot, i)} away "
        "from where the motion leads"
    )
    advice = "another method, such as lm, or more samples: the branch itself goes on there"
    return PlanFailure(FollowStatus.BRANCH_JUMP, s, name, reason, advice, smallest_singular_value(robot, before))
