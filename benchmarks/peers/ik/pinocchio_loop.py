"""Pinocchio: the damped inverse kinematics loop on log6 of its documentation, with full steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import LOOP_ITERATIONS, LOOP_TOLERANCE, LoopPeer
from benchmarks.peers.models import pinocchio_model
from optik.arm.robot import Robot
from optik.types import Array

CLIK_DAMPING = 1e-6
"""Damping of the loop, as in the documentation."""


class PinocchioLoop(LoopPeer):
    """The loop of Pinocchio's documentation with two changes: full steps instead of a tenth, and a tolerance of 7e-7."""

    distribution = "pin"
    package = "pinocchio"
    settings = (
        "the CLIK loop of the documentation in Python, dt = 1 instead of 0.1 (20 times faster, and more reliable near the "
        f"solution), damping {CLIK_DAMPING:g}, at most {LOOP_ITERATIONS} iterations, until |log6| < {LOOP_TOLERANCE:g}; "
        "no limits, no restarts"
    )

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        import pinocchio

        model = pinocchio_model(pinocchio, robot)
        tool = pinocchio.SE3(np.array(robot.tool))
        self.call = _loop(pinocchio, model, tool.inverse(), LOOP_ITERATIONS if iterations is None else iterations)
        data = model.createData()

        def pose(q: Array) -> Array:
            pinocchio.forwardKinematics(model, data, q)
            return np.asarray((data.oMi[model.njoints - 1] * tool).homogeneous)

        self.pose = pose

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by Pinocchio."""
        return self.pose(q)


def _loop(pin: Any, model: Any, tool_inverse: Any, most: int) -> Any:
    data, last, damping = model.createData(), model.njoints - 1, CLIK_DAMPING * np.eye(6)

    def solve(target: Array, q0: Array) -> tuple[Array, int, bool]:
        goal = pin.SE3(target) * tool_inverse
        q, iterations = q0, 0
        while True:
            pin.forwardKinematics(model, data, q)
            to_goal = data.oMi[last].actInv(goal)
            error = pin.log6(to_goal).vector
            converged = np.linalg.norm(error) < LOOP_TOLERANCE
            if converged or iterations == most:
                return q, iterations, bool(converged)
            jacobian = -pin.Jlog6(to_goal.inverse()) @ pin.computeJointJacobian(model, data, q, last)
            q = pin.integrate(model, q, -jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping, error))
            iterations += 1

    return solve


METHOD = PinocchioLoop
