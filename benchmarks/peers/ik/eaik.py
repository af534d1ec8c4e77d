"""EAIK: all branches in closed form, from the subproblems that the arm's axes decompose into (Ostermeier et al. 2024)."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import Peer, need_revolute, none, zero_frames
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array


class EAIK(Peer):
    """``HomogeneousRobot(frames at q = 0).IK(target)``."""

    distribution = "EAIK"
    package = "eaik"
    settings = (
        "HomogeneousRobot from the joint frames at q = 0; IK(target), all branches; it knows no limits and no start"
    )
    takes_start = False

    def __init__(self, robot: Robot) -> None:
        from eaik.IK_Homogeneous import HomogeneousRobot

        need_revolute(robot, 4, 6)
        self.robot = robot
        arm = HomogeneousRobot(zero_frames(robot))
        if not arm.hasKnownDecomposition():
            raise InvalidInput("robot", "axes without a known decomposition", "arms that decompose into subproblems")
        self.call = arm.IK

    def answers(self, raw: Any) -> Array:
        """All branches; where a branch has no exact solution, EAIK gives the nearest: our judgement drops it."""
        return np.asarray(raw.Q, dtype=np.float64).reshape(-1, self.robot.n) if len(raw.Q) else none(self.robot)


METHOD = EAIK
