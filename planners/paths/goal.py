"""The path from a configuration to a goal: a pose of the tool, or joints; and the windings of joints without limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import real_array
from optik.errors import InvalidInput
from optik.ik.problem import check_start
from optik.types import Array, Flags
from planners.paths.base import Path
from planners.paths.joint_line import JointLine
from planners.paths.line import Line

WINDINGS = ("nearest", "exact")
"""Choices of the winding of joints without limits: any one, the nearest if possible, or that of the given goal."""


def path_to(robot: Robot, goal: ArrayLike, q_start: ArrayLike | None, winding: str = "nearest") -> Path:
    """Return the path from a configuration to a goal: a straight line to a pose, or a line in joint space to joints."""
    start, goal = read_goal(robot, goal, q_start, winding)
    return JointLine(robot, start, goal) if goal.ndim == 1 else Line(robot.fk(start), goal)


def read_goal(robot: Robot, goal: ArrayLike, q_start: ArrayLike | None, winding: str) -> tuple[Array, Array]:
    """Return the start (n,) and a goal: a pose (4, 4), or joints (n,) [rad, m] with the winding to take."""
    expected = f"a Path, a pose (4, 4) or the {robot.n} joints of a goal"
    array = real_array(goal, "path", expected)
    if array.shape not in ((4, 4), (robot.n,)):
        raise InvalidInput("path", f"shape {array.shape}", expected)
    if q_start is None:
        raise InvalidInput("q_start", "None", "the configuration that the path to a goal starts from")
    start = check_start(robot, q_start, "q_start")
    if array.ndim == 1 and winding == "nearest":
        array = unwind(robot, check_start(robot, array, "q_goal"), start)
    return start, array


def find_continuous(robot: Robot) -> Flags:
    """Return the joints (n,) that turn without limits, also of the motors that move them."""
    free = robot.turning & np.isinf(robot.limits.lower) & np.isinf(robot.limits.upper)
    if robot.motors is not None:
        limited = ~(np.isinf(robot.motors.limits.lower) & np.isinf(robot.motors.limits.upper))
        free = free & ~(np.abs(robot.motors.inverse[limited]) > 0.0).any(axis=0)
    return np.asarray(free)


def unwind(robot: Robot, q: Array, near: Array) -> Array:
    """Return configurations (..., n) with each joint without limits at most half a turn from another configuration."""
    turn = 2.0 * np.pi
    return np.asarray(np.where(find_continuous(robot), q - turn * np.round((q - near) / turn), q))
