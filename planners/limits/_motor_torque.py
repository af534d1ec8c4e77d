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
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.limits._combination import Combination, CombinationLimit
from planners.limits.inputs import Gears, LimitedMotion, LimitedPath, PathPoints
from planners.limits.kinds import LoadedLimit, torque_rate_rows, torque_rows
from planners.limits.record import PLACES, dynamic_share, find_velocity_reversals
from planners.trajectory.curve import monomials


class MotorTorqueLimit(LoadedLimit, CombinationLimit):
    """Base of the limits on motor torques and on their rates; the record's matrix is Cᵀ."""

    def check_robot(self, robot: Robot, limit: Combination) -> None:
        """Raise InvalidInput for an arm without masses or motors."""
        super().check_robot(robot, limit)
        if robot.inertia is None or robot.motors is None:
            raise InvalidInput(self.name, f"{robot.name} without masses or motors", "an arm with both")

    def _pair(self, limit: Combination) -> Array:
        """Return the lower and the upper limits (2, m)."""
        return np.multiply.outer([-1.0, 1.0], limit.bound)

    def _gears(self, robot: Robot, limit: Combination) -> Gears:
        """Return the motors."""
        motors: Any = robot.motors
        return Gears(np.array(limit.matrix), motors.inverse, motors.inertia, motors.viscous, motors.coulomb)

    def _rows_of(self, at: PathPoints, limit: Combination, load: Load) -> Array:
        gears, limits = self._gears(at.joint_path.robot, limit), np.array(limit.bound)[:, None]
        q1, q2, q3 = (at.q(order) @ gears.turns.T for order in (1, 2, 3))
        rows = (torque_rate_rows if self.rate else torque_rows)(at, load)
        rows = np.einsum("mn,knc->kmc", gears.matrix, rows)
        if self.rate:
            for column, value in enumerate((q1, 3.0 * q2, q3)):
                rows[..., column] += gears.inertia * value
            rows[..., 4] += gears.viscous * q1
            rows[..., 5] += gears.viscous * q2
            return np.asarray(rows / limits)
        still = find_velocity_reversals(q1)
        rows[..., 0] += gears.inertia * q1
        rows[..., 1] += gears.inertia * q2
        rows[..., 2] += gears.viscous * q1
        rows[..., 3] += np.where(still, 0.0, gears.coulomb * np.sign(q1))
        return np.asarray(rows / np.maximum(limits - np.where(still, gears.coulomb, 0.0)[..., None], 1e-9))

    def excess(self, motion: LimitedMotion, limit: Combination) -> Array:
        """Return the dynamic share of each row, of the motion as a path whose parameter is the time."""
        states, t = motion.states(PLACES[::2])
        at = PathPoints(cast(Any, motion), t.ravel(), tuple(states.reshape(t.size, 6, -1).swapaxes(0, 1)[:4]))
        rows = self.rows(at, limit)
        value = (rows @ np.array(monomials(tuple(np.eye(3)[: self.order, 0]), full=True))).reshape(*t.shape, -1)
        static = 0.0 if self.rate else rows[..., 3].reshape(value.shape)
        return dynamic_share(np.abs(value), np.copysign(1.0, value) * static)

    def check_still(self, joint_path: LimitedPath, limit: Combination) -> None:
        """Refuse a path on which a motor cannot hold the arm."""
        if self.rate:
            return
        robot, s = joint_path.robot, np.linspace(0.0, joint_path.end, 65)
        gears, at = self._gears(robot, limit), PathPoints(joint_path, s)
        weights = [np.abs(torque_rows(at, load)[..., 3] @ gears.matrix.T) for load in robot.loads]
        ratio = (np.max(weights, axis=0) + gears.coulomb) / limit.bound
        k, i = (int(x) for x in np.unravel_index(int(ratio.argmax()), ratio.shape))
        if ratio[k, i] >= 1.0:
            raise NoSolution(
                f"gravity needs {ratio[k, i]:.4g} times the torque limit of {limit.names[i]} at s = {s[k]:.6g}",
                s=float(s[k]), advice="another path, a lighter payload, or a higher limit",
            )  # fmt: skip
