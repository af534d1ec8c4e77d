"""Limits on the torques, or on their rates, of motors that move several axes.

The axes' torques τ_q act on the motors as Cᵀ τ_q. With E = C⁻¹, the rotors' inertia I and the friction of the motors,

    τ_m = Cᵀ τ_q + I E q̈ + viscous E q̇ + coulomb sign(E q̇).

Coulomb friction counts with its sign where a motor does not reverse, else with both. The proof is that of joint torques.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from optik.arm.inertia import Load
from optik.arm.robot import Robot
from optik.dynamics import torques_batch
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.limits._combination import Combination, CombinationLimit
from planners.limits.inputs import Gears, LimitedMotion, LimitedPath, PathPoints
from planners.limits.kinds import LoadedLimit, torque_rate_rows, torque_rows
from planners.limits.record import PLACES, dynamic_share, find_velocity_reversals

AT_REST = 1e-9
"""Velocity [rad/s, m/s] of a motor that rests or reverses."""


class MotorTorqueLimit(LoadedLimit, CombinationLimit):
    """Base of the limits on motor torques and on their rates; the record's matrix is Cᵀ."""

    def check_robot(self, robot: Robot, bound: Combination) -> None:
        """Raise InvalidInput for an arm without masses or motors."""
        super().check_robot(robot, bound)
        if robot.inertia is None or robot.motors is None:
            raise InvalidInput(self.name, f"{robot.name} without masses or motors", "an arm with both")

    def _pair(self, bound: Combination) -> Array:
        """Return the lower and the upper limits (2, m)."""
        return np.multiply.outer([-1.0, 1.0], bound.bound)

    def _gears(self, robot: Robot, bound: Combination) -> Gears:
        """Return the motors."""
        motors: Any = robot.motors
        return Gears(np.array(bound.matrix), motors.inverse, motors.inertia, motors.viscous, motors.coulomb)

    def _torques(self, robot: Robot, load: Load, bound: Combination, states: Array) -> Array:
        """Return the motors' torques (k, m) without Coulomb friction, or their rates, at states (k, 4, n)."""
        gears, order, out = self._gears(robot, bound), 2 if self.rate else 1, np.empty((len(states), 2, robot.n))
        torques_batch(robot.chain, load.bodies, load.viscous, np.ascontiguousarray(states), out)
        turned = states @ gears.turns.T
        rotors = gears.inertia * turned[:, order + 1] + gears.viscous * turned[:, order]
        return np.asarray(out[:, order - 1] @ gears.matrix.T + rotors)

    def _ratios(self, robot: Robot, bound: Combination, states: Array) -> Array:
        """Return the largest ratios (k, m) of all loads, with friction, at states (k, 4, n)."""
        limits, motors = np.array(bound.bound), cast(Any, robot.motors)
        each = np.array([self._torques(robot, load, bound, states) for load in robot.loads])
        if not self.rate:
            turns = motors.of(states[:, 1], 1)
            each += motors.coulomb * np.where(
                np.abs(turns) > AT_REST, np.sign(turns), np.sign(each)
            )  # at rest either sign
        return np.asarray(np.abs(each).max(axis=0) / limits)

    def _rows_of(self, at: PathPoints, bound: Combination, load: Load) -> Array:
        robot = at.joint_path.robot
        motors, T, limits = cast(Any, robot.motors), np.array(bound.matrix), np.array(bound.bound)[:, None]
        E = motors.inverse
        q1, q2, q3 = (at.q(order) @ E.T for order in (1, 2, 3))
        rows = np.einsum("mn,knc->kmc", T, torque_rate_rows(at, load) if self.rate else torque_rows(at, load))
        if self.rate:
            for column, value in enumerate((q1, 3.0 * q2, q3)):
                rows[..., column] += motors.inertia * value
            rows[..., 4] += motors.viscous * q1
            rows[..., 5] += motors.viscous * q2
            return np.asarray(rows / limits)
        still = find_velocity_reversals(q1)
        rows[..., 0] += motors.inertia * q1
        rows[..., 1] += motors.inertia * q2
        rows[..., 2] += motors.viscous * q1
        rows[..., 3] += np.where(still, 0.0, motors.coulomb * np.sign(q1))
        return np.asarray(rows / np.maximum(limits - np.where(still, motors.coulomb, 0.0)[..., None], 1e-9))

    def excess(self, motion: LimitedMotion, bound: Combination) -> Array:
        """Return the dynamic share of each row, those of every load side by side."""
        states, t = motion.states(PLACES[::2])
        states = states.reshape(-1, *states.shape[2:])[:, :4]
        still = states * np.eye(4)[0, :, None]
        moving, static = (self._ratios(motion.robot, bound, x).reshape(*t.shape, -1) for x in (states, still))
        return np.tile(dynamic_share(moving, static), len(motion.robot.loads))

    def check_still(self, joint_path: LimitedPath, bound: Combination) -> None:
        """Refuse a path on which a motor cannot hold the arm."""
        if self.rate:
            return
        s = np.linspace(0.0, joint_path.end, 65)
        q = joint_path(s)
        ratio = self._ratios(joint_path.robot, bound, np.stack([q, 0.0 * q, 0.0 * q, 0.0 * q], axis=1))
        k, i = (int(x) for x in np.unravel_index(int(ratio.argmax()), ratio.shape))
        if ratio[k, i] >= 1.0:
            raise NoSolution(
                f"gravity needs {ratio[k, i]:.4g} times the torque limit of {bound.names[i]} at s = {s[k]:.6g}",
                s=float(s[k]), advice="another path, a lighter payload, or a higher limit",
            )  # fmt: skip
