"""The path from a configuration to a goal: a pose of the tool, or joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik._problem import check_start
from planners.paths.base import Path
from planners.paths.joint_line import JointLine
from planners.paths.line import Line


def path_to(robot: Robot, goal: ArrayLike, q_start: ArrayLike | None) -> Path:
    """Return the path from a configuration to a goal: a straight line to a pose, or a line in joint space to joints."""
    expected = f"a Path, a pose (4, 4) or the {robot.n} joints of a goal"
    try:
        array = np.asarray(goal, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInput("path", repr(goal)[:60], expected) from None
    if array.shape not in ((4, 4), (robot.n,)):
        raise InvalidInput("path", f"shape {array.shape}", expected)
    if q_start is None:
        raise InvalidInput("q_start", "None", "the configuration that the path to a goal starts from")
    if array.shape == (robot.n,):
        return JointLine(robot, q_start, array)
    return Line(robot.fk(check_start(robot, q_start, "q_start")), array)
