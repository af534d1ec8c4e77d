"""Pinocchio: the damped loop on log6 that its documentation teaches for inverse kinematics, with a full step."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import Peer, one
from optik.arm.robot import Robot
from optik.types import Array

DAMPING, ITERATIONS, CLOSE = 1e-6, 100, 7e-7


class PinocchioLoop(Peer):
    """The documentation's loop, tuned: full steps in place of a tenth, and it stops at 7e-7."""

    distribution = "pin"
    package = "pinocchio"
    settings = (
        f"the documentation's CLIK loop in Python, dt = 1 in place of 0.1 (20 times faster, and surer near the solution), "
        f"damping {DAMPING:g}, at most {ITERATIONS} iterations, until |log6| < {CLOSE:g}; no limits, no restarts"
    )

    def __init__(self, robot: Robot) -> None:
        import pinocchio

        model = pinocchio.Model()
        for i in range(robot.n):
            joint = pinocchio.JointModelPZ() if robot.prismatic[i] else pinocchio.JointModelRZ()
            model.addJoint(i, joint, pinocchio.SE3(np.array(robot.fixed[i])), robot.joint_names[i])
        self.call = _loop(pinocchio, model, pinocchio.SE3(np.array(robot.tool)).inverse())

    def answers(self, raw: Any) -> Array:
        """Its one answer."""
        return one(raw[0])

    def iterations(self, raw: Any) -> int | None:
        """Of the one loop."""
        return int(raw[1])


def _loop(pin: Any, model: Any, tool_inverse: Any) -> Any:
    data, last, damping = model.createData(), model.njoints - 1, DAMPING * np.eye(6)

    def solve(target: Array, q0: Array) -> tuple[Array, int]:
        goal = pin.SE3(target) * tool_inverse
        q, iterations = q0, 0
        while True:
            pin.forwardKinematics(model, data, q)
            to_goal = data.oMi[last].actInv(goal)
            error = pin.log6(to_goal).vector
            if np.linalg.norm(error) < CLOSE or iterations == ITERATIONS:
                return q, iterations
            jacobian = -pin.Jlog6(to_goal.inverse()) @ pin.computeJointJacobian(model, data, q, last)
            q = pin.integrate(model, q, -jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping, error))
            iterations += 1

    return solve


METHOD = PinocchioLoop
