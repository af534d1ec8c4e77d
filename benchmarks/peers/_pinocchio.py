"""An arm as a model of Pinocchio, for the peers that compute with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from optik.arm.robot import Robot


def pinocchio_model(pin: Any, robot: Robot) -> Any:
    """Return Pinocchio's model of an arm with position limits, without other limits, with the frame ``tool``."""
    model, last, infinite = pin.Model(), 0, np.array([np.inf])
    for i in range(robot.n):
        joint = pin.JointModelPZ() if robot.prismatic[i] else pin.JointModelRZ()
        lower, upper = robot.limits.lower[i : i + 1].copy(), robot.limits.upper[i : i + 1].copy()
        placement = pin.SE3(np.array(robot.fixed[i]))
        last = model.addJoint(last, joint, placement, robot.joint_names[i], infinite, infinite, lower, upper)
    model.addFrame(pin.Frame("tool", last, 0, pin.SE3(np.array(robot.tool)), pin.FrameType.OP_FRAME))
    return model
