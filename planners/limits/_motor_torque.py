"""Limits on the torques, or on their rates, of motors that move several axes.

The axes' torques τ_q act on the motors as Cᵀ τ_q. With E = C⁻¹, the rotors' inertia I and the friction of the motors,

    τ_m = Cᵀ τ_q + I E q̈ + viscous E q̇ + coulomb sign(E q̇).

On an interval of time h it is within h⁴ / 384 max|τ_m⁗| of its cubic Hermite interpolant, and its rate within √3 h³ / 216
max|τ_m⁗| of that of the interpolant, with |τ_m⁗| ≤ |C|ᵀ |τ_q⁗| + viscous |E q⁽⁵⁾| (`planners.certificate.torque`).
Coulomb friction counts with its sign where a motor does not reverse, else with both.
"""

from __future__ import annotations

from typing import Any, ClassVar, cast

import numpy as np

from optik.arm.inertia import Load
from optik.arm.robot import Robot
from optik.dynamics import torques_batch
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.limits._combination import Combination, CombinationLimit
from planners.limits.inputs import Extreme, LimitedMotion, LimitedPath, PathPoints
from planners.limits.kinds import torque_rate_rows, torque_rows
from planners.limits.record import PLACES, SampledLimit, find_velocity_reversals

TORQUE_EXCESS = 1e-5
"""Largest excess of a proved torque over the largest one found."""


AT_REST = 1e-9
"""Velocity [rad/s, m/s] of a motor that rests or reverses."""


class MotorTorqueLimit(SampledLimit, CombinationLimit):
    """Base of the limits on motor torques and on their rates; the record's matrix is Cᵀ."""

    homogeneous: ClassVar[bool] = False
    rate: ClassVar[bool]

    def check_robot(self, robot: Robot, bound: Combination) -> None:
        """Raise InvalidInput for an arm without masses or motors."""
        super().check_robot(robot, bound)
        if robot.inertia is None or robot.motors is None:
            raise InvalidInput(self.name, f"{robot.name} without masses or motors", "an arm with both")

    # ------------------------------------------------------------ torques of states

    def _torques(self, robot: Robot, load: Load, bound: Combination, states: Array) -> tuple[Array, Array]:
        """Return the motors' torques without Coulomb friction, and their rates (k, m), at states (k, 4, n)."""
        motors: Any = robot.motors
        out = np.empty((len(states), 2, robot.n))
        torques_batch(robot.chain, load.bodies, load.viscous, np.ascontiguousarray(states), out)
        turned = states[:, 1:] @ motors.inverse.T
        out = out @ np.array(bound.matrix).T
        out += motors.inertia * turned[:, 1:3] + motors.viscous * turned[:, :2]
        return out[:, 0], out[:, 1]

    def _ratios(self, robot: Robot, bound: Combination, states: Array) -> Array:
        """Return the largest ratios (k, m) of all loads, with friction, at states (k, ≥ 4, n)."""
        limits, motors = np.array(bound.bound), cast(Any, robot.motors)
        each = np.array([self._torques(robot, load, bound, states[:, :4])[self.rate] for load in robot.loads])
        if not self.rate:
            turns = motors.of(states[:, 1], 1)
            each += motors.coulomb * np.where(
                np.abs(turns) > AT_REST, np.sign(turns), np.sign(each)
            )  # at rest either sign
        return np.asarray(np.abs(each).max(axis=0) / limits)

    def sample_ratios(self, motion: LimitedMotion, bound: Combination, c: float = 1.0) -> Array:
        """Return the ratios (m, k, motors) of a motion stretched by c at sampled instants."""
        states, t = motion.states(PLACES[::2])
        states = states.reshape(-1, *states.shape[2:])[:, :4] * c ** -np.arange(4.0)[:, None]
        return self._ratios(motion.robot, bound, states).reshape(*t.shape, -1)

    # ------------------------------------------------------------ Limit

    def rows(self, at: PathPoints, bound: Combination) -> Array:
        """Return the rows of every load at points of a joint path."""
        robot = at.joint_path.robot
        motors, T, limits = cast(Any, robot.motors), np.array(bound.matrix), np.array(bound.bound)[:, None]
        E = motors.inverse
        q1, q2, q3 = (at.q(order) @ E.T for order in (1, 2, 3))
        still, out = find_velocity_reversals(q1), []
        for load in robot.loads:
            axes = torque_rate_rows(at, load) if self.rate else torque_rows(at, load)
            rows = np.einsum("mn,knc->kmc", T, axes)
            if self.rate:
                for column, value in enumerate((q1, 3.0 * q2, q3)):
                    rows[..., column] += motors.inertia * value
                rows[..., 4] += motors.viscous * q1
                rows[..., 5] += motors.viscous * q2
                out.append(rows / limits)
                continue
            rows[..., 0] += motors.inertia * q1
            rows[..., 1] += motors.inertia * q2
            rows[..., 2] += motors.viscous * q1
            rows[..., 3] += np.where(still, 0.0, motors.coulomb * np.sign(q1))
            out.append(rows / np.maximum(limits - np.where(still, motors.coulomb, 0.0)[..., None], 1e-9))
        return np.concatenate(out, axis=1)

    def excess(self, motion: LimitedMotion, bound: Combination) -> Array:
        """Return the dynamic share of each row, those of every load side by side."""
        return np.tile(super().excess(motion, bound), len(motion.robot.loads))

    def judge(self, motion: LimitedMotion, bound: Combination) -> Extreme:
        """Return the proved peak values, their ratios and their times."""
        robot, limits = motion.robot, np.array(bound.bound)
        motors, T, count = cast(Any, robot.motors), np.abs(np.array(bound.matrix)), len(bound.bound)

        def evaluate(joints: Array) -> Array:
            each = [np.concatenate(self._torques(robot, load, bound, joints[:, :4]), axis=1) for load in robot.loads]
            return np.concatenate([self._ratios(robot, bound, joints), motors.of(joints[:, 1], 1), *each], axis=1)

        def enclose(first: Array, last: Array, h: Array, B: Array, P: Array, D: Array) -> Array:
            found = np.zeros((h.size, count))
            fast = np.abs(motors.inverse) @ D[:, 2, :, None]
            turns = np.minimum(np.abs(first[:, count : 2 * count]), np.abs(last[:, count : 2 * count]))
            one_way = (first[:, count : 2 * count] * last[:, count : 2 * count] > 0.0) & (
                turns > h[:, None] * fast[..., 0]
            )
            sign = np.where(one_way, np.sign(first[:, count : 2 * count]), 0.0)
            fifth = motors.viscous * (D[:, 5] @ np.abs(motors.inverse).T)
            for i, load in enumerate(robot.loads):
                columns = slice((2 + 2 * i) * count, (4 + 2 * i) * count)
                (a, c), (b, d) = (np.split(x[:, columns], 2, axis=1) for x in (first, last))
                fourth = motion.fourth_bounds(load, D) @ T.T + fifth
                third = h[:, None] / 3.0
                if self.rate:
                    slopes = np.stack([c, (b - third * d - a - third * c) / third, d])
                    off = np.sqrt(3.0) * h[:, None] ** 3 / 216.0 * fourth
                    found = np.maximum(found, np.abs(slopes).max(axis=0) + off)
                    continue
                points, off = np.stack([a, a + third * c, b - third * d, b]), h[:, None] ** 4 / 384.0 * fourth
                high, low = points.max(axis=0) + off, points.min(axis=0) - off
                up, down = np.where(sign < 0.0, -1.0, 1.0), np.where(sign > 0.0, 1.0, -1.0)
                found = np.maximum(found, np.maximum(high + up * motors.coulomb, -low - down * motors.coulomb))
            return np.asarray(found / limits)

        ratio, time = motion.prove_peaks((self.name, bound), evaluate, enclose, TORQUE_EXCESS, count)
        if motion.jumps[: self.order].any():
            ratio = np.full(count, np.inf)
        return Extreme(
            np.where(np.isfinite(limits), ratio * limits, np.nan), np.where(np.isfinite(limits), ratio, np.nan), time
        )

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
