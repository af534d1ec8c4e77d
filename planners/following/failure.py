"""Failures of path following: their statuses, reasons and advice."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Self

import numpy as np

import optik
from optik.arm.motors import ranges_of
from optik.arm.reach import ask_unit, outside_reach
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.ik import IKResult, IKSolver, IKStatus, Tolerance
from optik.types import Array
from planners.following import march
from planners.following.track import TrackEnd, singular_value_at
from planners.paths.base import Path

CLEARLY_REGULAR = 1e-2
"""Smallest singular value above which the end of a branch does not count as singular."""
BEYOND = 1e-3
"""Distance behind the end of a branch, as a fraction of the path, at which other configurations are searched."""
EXACT_TOLERANCE = Tolerance(1e-9, 1e-9)
"""Tolerance [m, rad] with which an arm of fewer than six joints reaches a pose: it nearly reaches many others."""
RANK_DRAWS = 20
"""Random configurations at which the rank of an arm is computed; almost all configurations have the same."""
ASKED = ": is the path discontinuous?"
"""Question of a failure at a regular configuration; the search along the whole path answers it."""
ZERO_FRACTION = 1e-10
"""A singular value below this fraction of the largest is rounding."""


class FollowStatus(StrEnum):
    """Outcome of following a path."""

    SOLVED = "solved"
    NO_IK = "no_ik"
    OUTSIDE_LIMITS = "outside_limits"
    BRANCH_JUMP = "branch_jump"
    SINGULAR = "singular"
    UNREACHABLE = "unreachable"
    CONTACT = "contact"
    NO_LENGTH = "no_length"
    NO_PATH_FOUND = "no_path_found"


@dataclass(frozen=True)
class PlanFailure:
    """Place and reason of a motion's early end.

    Attributes
    ----------
    status : StrEnum
        How it ended.
    s : float
        Path parameter [m, or rad].
    joint : str or None
        Joint whose limit is violated, or None.
    reason, advice : str
        Why, with numbers; and what to change.
    singular_value : float
        Smallest singular value of the Jacobian at the last valid configuration; NaN if there is none.
    part : int or None
        The part of a program, from 0, to which s belongs.
    """

    status: StrEnum
    s: float
    joint: str | None
    reason: str
    advice: str
    singular_value: float = float("nan")
    part: int | None = None

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
    """Return the failure of an arm whose Jacobian is rank-deficient everywhere, or None."""
    rank, full = find_rank(robot), min(robot.n, 6)
    if rank == full:
        return None
    reason = (
        f"the Jacobian of {robot.name} has rank {rank} of {full} at each of {RANK_DRAWS} random configurations: its {robot.n} "
        f"joints move the tool in {rank} directions only, so a pose does not determine them"
    )
    return PlanFailure(FollowStatus.SINGULAR, 0.0, None, reason, "a path in the joints, such as JointLine", 0.0)


def format_position(path: Path, s: float) -> str:
    """Return a path parameter with its unit, as text."""
    return f"s = {s:.6g} {path.unit}"


def explain_end(robot: Robot, path: Path, reach: Array, ended: TrackEnd, q: Array) -> PlanFailure:
    """Return the failure at the end of a branch, by its last valid configuration and the path just behind the end."""
    sigma, s, at = singular_value_at(robot, q), ended.s, format_position(path, ended.s)
    if asked := _ask_unit(path, reach):
        return PlanFailure(
            FollowStatus.UNREACHABLE, s, None, asked, "coordinates in metres: are these in millimetres?", sigma
        )
    if ended.code == march.LIMIT:
        i, ranges = ended.joint, ranges_of(robot)
        name, low, high, unit = ranges.names[i], ranges.lower[i], ranges.upper[i], joint_unit(robot, ranges.axis[i])
        reason = f"{name} reaches the end of its range [{low:.6g}, {high:.6g}] {unit} at {at}"
        return PlanFailure(FollowStatus.OUTSIDE_LIMITS, s, name, reason, "", sigma)
    status, reason = _explain_beyond(robot, path, reach, ended, q, sigma)
    return PlanFailure(status, s, None, reason, "", sigma)


def _ask_unit(path: Path, reach: Array) -> str:
    """Return words on a path that ends so far away that its coordinates are probably in millimetres."""
    distance = outside_reach(reach, path.pose(path.end), 0.0, 0.0)
    far = f"the path ends {distance:.4g} m away, and the arm reaches {reach[7]:.4g} m"
    return far if ask_unit(distance, reach[7]) else ""


def _explain_beyond(
    robot: Robot, path: Path, reach: Array, ended: TrackEnd, q: Array, sigma: float
) -> tuple[FollowStatus, str]:
    """Return status and reason of an end that is not at a limit, by solving the IK just behind it."""
    s, at = ended.s, format_position(path, ended.s)
    beyond = path.pose(min(s + BEYOND * path.end, path.end))
    distance = outside_reach(reach, beyond, 0.0, 0.0)
    if distance >= 0.0:
        bound = f"at most {reach[7]:.6g}" if distance > reach[7] else f"at least {reach[6]:.6g}"
        return FollowStatus.UNREACHABLE, (
            f"the path leaves the arm's reach at {at}: just beyond, the first and the last joint's axes would be "
            f"{distance:.6g} m apart, and the links allow {bound} m"
        )
    if robot.n < 6 and ended.code == march.NOT_MET and sigma > CLEARLY_REGULAR:
        few = f"{robot.name} has {robot.n} joints and cannot follow this path from {at} on"
        target = path.pose(min(s + 10.0 * BEYOND * path.end, path.end))
        near = optik.solve_ik(robot, target, robot.limits.clip(q), tolerance=EXACT_TOLERANCE)
        if near:
            return FollowStatus.BRANCH_JUMP, f"{few} without a jump to another configuration"
        off = f"{1e3 * near.position_error:.3g} mm and {np.degrees(near.rotation_error):.3g}° off"
        return FollowStatus.UNREACHABLE, f"{few}: the nearest pose slightly further is {off}"
    result = optik.solve_ik(robot, beyond, robot.limits.clip(q))
    this = "this branch" if robot.n <= 6 else "this null-space motion"
    if result and sigma > CLEARLY_REGULAR:
        words = f"no continuous motion continues at {at}, where the arm is not singular{ASKED}"
        return FollowStatus.BRANCH_JUMP, words
    close = f": the smallest singular value comes to {march.SMALLEST_SINGULAR_VALUE:g} or below"
    singular = f"the arm is singular at {at}{close if ended.code == march.SINGULAR else f', {this} ends there'}"
    if result:
        return FollowStatus.SINGULAR, f"{singular}; beyond, another configuration goes on"
    if result.status is IKStatus.OUTSIDE_LIMITS:
        words = f"{singular}; beyond, the path was reached only with joints outside their limits"
        return FollowStatus.SINGULAR, words
    return FollowStatus.UNREACHABLE, (
        f"the path leaves the reachable poses at {at}: none of {result.restarts + 1} initial guesses led beyond"
    )


def explain_ik_failure(solver: IKSolver, path: Path, s: float, result: IKResult, before: Array) -> PlanFailure:
    """Return the failure of the IK method where the branch continues."""
    sigma, at = singular_value_at(solver.robot, before), format_position(path, s)
    reason = (
        f"{solver.name} found no configuration at {at} ({result.status}: {1e3 * result.position_error:.3g} mm and "
        f"{np.degrees(result.rotation_error):.3g}° away), where the branch continues; smallest singular value {sigma:.2g}"
    )
    advice = f"another method, such as lm; {result.status.advice}"
    return PlanFailure(FollowStatus.NO_IK, s, None, reason, advice, sigma)


def explain_branch_jump(solver: IKSolver, path: Path, s: float, step: Array, before: Array) -> PlanFailure:
    """Return the failure of an IK method that converged to another branch."""
    robot, i = solver.robot, int(np.argmax(np.abs(step)))
    name, at = robot.joint_names[i], format_position(path, s)
    reason = (
        f"{solver.name} jumps to another configuration at {at}: {name} is {step[i]:.3g} {joint_unit(robot, i)} away "
        "from the tracked branch"
    )
    advice = "another method, such as lm, or more samples: the branch itself continues there"
    return PlanFailure(FollowStatus.BRANCH_JUMP, s, name, reason, advice, singular_value_at(robot, before))
