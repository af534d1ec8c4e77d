"""A motion under examination: what several judgements need of it, each computed once."""

from __future__ import annotations

from functools import cached_property

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Flags
from planners.certificate import continuity
from planners.certificate.bounds import MotionBounds
from planners.certificate.path_error import ERROR_FLOOR, Passage, PathError, path_error
from planners.certificate.tool_speed import ToolSpeed, tool_speed
from planners.certificate.torque import TorqueBounds
from planners.paths.base import Path
from planners.trajectory import Trajectory


class MotionAnalysis:
    """A motion of an arm, and what is known of it."""

    def __init__(
        self,
        robot: Robot,
        trajectory: Trajectory,
        path: Path | None = None,
        enough: tuple[float, float] = (ERROR_FLOOR, ERROR_FLOOR),
    ) -> None:
        self.robot, self.trajectory, self._path, self._enough = robot, trajectory, path, enough

    @property
    def has_path(self) -> bool:
        """Whether the motion has a path."""
        return self._path is not None

    @property
    def path(self) -> Path:
        """The path; raises InvalidInput where none is known."""
        if self._path is None:
            raise InvalidInput("path", "none", "the path of the motion: limits of its segments need it")
        return self._path

    @cached_property
    def along(self) -> tuple[PathError, Passage]:
        """How far the tool leaves its path, and where on it the motion is."""
        return path_error(self.robot, self.path, self.trajectory, self.bounds, self._enough)

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
        return TorqueBounds(self.robot, self.bounds.knots, *self.bounds.joint_ends)

    @cached_property
    def jumps(self) -> Flags:
        """Where (4, m + 1, n) a joint's derivative of order 0 to 3 jumps."""
        return continuity.jumps(self.trajectory)

    @cached_property
    def rest(self) -> tuple[bool, bool]:
        """Whether the motion starts and ends at rest."""
        return continuity.rest(self.trajectory)


NO_FINER = (ERROR_FLOOR, ERROR_FLOOR)
"""Distance [m] and angle [rad] of a path error that need not be finer by default: those of rounding."""
OF_THE_MOTION = ("bounds", "tool_speed", "torques", "jumps", "rest")
"""What is known of a motion whatever path it follows."""
_LAST: list[MotionAnalysis] = []
"""The motion that was examined last: a law, the fit and the certificate judge the same one in turn."""


def analyse_motion(
    robot: Robot, trajectory: Trajectory, path: Path | None = None, enough: tuple[float, float] = NO_FINER
) -> MotionAnalysis:
    """Return a motion under examination, with all that is known of it where it is the one that was examined last."""
    motion = MotionAnalysis(robot, trajectory, path, enough)
    for last in _LAST[:]:
        if last.trajectory is trajectory and last.robot == robot:
            known = vars(last)
            vars(motion).update({name: known[name] for name in OF_THE_MOTION if name in known})
    _LAST[:] = [motion]
    return motion
