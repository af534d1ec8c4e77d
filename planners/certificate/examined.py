"""A motion under examination: what several judgements need of it, each computed once."""

from __future__ import annotations

from functools import cached_property

from optik.arm.robot import Robot
from optik.types import Flags
from planners.certificate import continuity
from planners.certificate.bounds import MotionBounds
from planners.certificate.tool_speed import ToolSpeed, tool_speed
from planners.certificate.torque import TorqueBounds
from planners.trajectory import Trajectory


class Examined:
    """A motion of an arm, and what is known of it.

    Parameters
    ----------
    robot : Robot
        The arm.
    trajectory : Trajectory
        Its motion.
    """

    def __init__(self, robot: Robot, trajectory: Trajectory) -> None:
        self.robot, self.trajectory = robot, trajectory

    @cached_property
    def bounds(self) -> MotionBounds:
        """Bounds on the derivatives of the tool's motion."""
        return MotionBounds(self.robot, self.trajectory)

    @cached_property
    def tool_speed(self) -> ToolSpeed:
        """Proved bounds on the tool's speeds."""
        return tool_speed(self.robot, self.trajectory, self.bounds)

    @cached_property
    def torques(self) -> TorqueBounds:
        """Its torques, and proved bounds on them; raises `InvalidInput` where the arm's masses are unknown."""
        first, last = self.bounds.ends
        return TorqueBounds(self.robot, self.bounds.knots, first.joints, last.joints)

    @cached_property
    def jumps(self) -> Flags:
        """Where (4, m + 1, n) a joint's derivative of order 0 to 3 jumps."""
        return continuity.jumps(self.trajectory)

    @cached_property
    def rest(self) -> tuple[bool, bool]:
        """Whether the motion starts and ends at rest."""
        return continuity.rest(self.trajectory)


_LAST: list[Examined] = []
"""The motion that was examined last: a law, the fit and the certificate judge the same one in turn."""


def examined(robot: Robot, trajectory: Trajectory) -> Examined:
    """Return a motion under examination: the last one again, with all that is known of it, where it is the same.

    Parameters
    ----------
    robot : Robot
        The arm.
    trajectory : Trajectory
        Its motion.

    Returns
    -------
    Examined
        The motion.
    """
    for last in _LAST[:]:
        if last.trajectory is trajectory and last.robot == robot:
            return last
    _LAST[:] = [Examined(robot, trajectory)]
    return _LAST[0]
