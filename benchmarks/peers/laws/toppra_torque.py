"""TOPP-RA with torque limits (``joint_torque_constraint``), and ParametrizeConstAccel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from benchmarks.peers.laws.toppra_const_accel import TOPPRA_INTERVALS, ToppraConstAccel
from optik.arm.inertia import Load
from optik.arm.robot import Robot
from optik.dynamics import torques_batch
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import sides


class ToppraTorque(ToppraConstAccel):
    """`ToppraConstAccel` with one ``joint_torque_constraint`` for each load: the lightest and the heaviest payload.

    The constraint evaluates our inverse dynamics without friction, and takes Coulomb friction as a separate argument. It
    cannot represent viscous friction.
    """

    settings = (
        f"SplineInterpolator through the samples of the joint path, {TOPPRA_INTERVALS} equal grid intervals, "
        "JointVelocityConstraint, JointAccelerationConstraint and joint_torque_constraint (interpolation scheme) with our "
        "inverse dynamics and Coulomb friction, without viscous friction, which it does not know; ParametrizeConstAccel; no "
        "limits on jerk or on the torque's rate"
    )
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration", "torque")

    def __init__(self, limits: dict[str, Array]) -> None:
        super().__init__(limits)
        self._torque = limits.get("torque")

    def _all_constraints(self, joint_path: JointPath) -> list[Any]:
        if self._torque is None or not np.isfinite(self._torque).any():
            return self._constraints
        kinds, robot = self._toppra.constraint, joint_path.robot
        within = np.stack(sides(self._torque), axis=1)
        scheme = kinds.DiscretizationType.Interpolation
        return self._constraints + [
            kinds.SecondOrderConstraint.joint_torque_constraint(
                _dynamics(robot, load), within, load.coulomb, discretization_scheme=scheme
            )
            for load in robot.loads
        ]


def _dynamics(robot: Robot, load: Load) -> Callable[[Array, Array, Array], Array]:
    """Return the inverse dynamics of one load without friction, as TOPP-RA calls it: for one state."""
    state, out, frictionless = np.zeros((1, 4, robot.n)), np.empty((1, 2, robot.n)), np.zeros(robot.n)

    def torque(q: Array, dq: Array, ddq: Array) -> Array:
        state[0, :3] = q, dq, ddq
        torques_batch(robot.chain, load.bodies, frictionless, state, out)
        return np.array(out[0, 0])

    return torque


METHOD = ToppraTorque
