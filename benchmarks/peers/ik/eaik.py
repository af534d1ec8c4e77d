"""EAIK: all branches in closed form, by decomposition of the arm into subproblems (Ostermeier et al. 2024)."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import Solutions, SolverPeer, need_revolute, none
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array


class EAIK(SolverPeer):
    """``HomogeneousRobot(frames at q = 0).IK(target)``."""

    distribution = "EAIK"
    package = "eaik"
    settings = (
        "HomogeneousRobot from the joint frames at q = 0; IK(target), all branches; without joint limits and start"
    )
    takes_start = False

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        from eaik.IK_Homogeneous import HomogeneousRobot

        need_revolute(robot, 4, 6)
        self.robot = robot
        arm = HomogeneousRobot(robot.frames(np.zeros(robot.n)))
        if not arm.hasKnownDecomposition():
            raise InvalidInput("robot", "axes without a known decomposition", "an arm that decomposes into subproblems")
        self.arm: Any = arm
        self.call = arm.IK

    def read(self, raw: Any) -> Solutions:
        """Return all branches; for one without an exact solution EAIK returns the nearest, and marks it as least squares."""
        if not len(raw.Q):
            return Solutions(none(self.robot), claimed=False)
        return Solutions(np.asarray(raw.Q, dtype=np.float64).reshape(-1, self.robot.n), not bool(np.all(raw.is_LS)))

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by EAIK's product of exponentials."""
        return np.asarray(self.arm.fwdKin(q))


METHOD = EAIK
