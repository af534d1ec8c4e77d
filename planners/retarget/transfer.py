"""Time-optimal joint motions between two states, by Ruckig (Berscheid and Kröger, RSS 2021)."""

from __future__ import annotations

from typing import Any

import numpy as np

from optik.types import Array
from planners.retarget.cubics import SAME_TIME, JointCubics, join_phases

INSIDE = 2e-8
"""Distance [rad, m] to the end of a range at which a jogged joint stops: above what Ruckig's goals are off by."""


class Transfer:
    """Motions between states within the limits (n, 4, 2) of position, velocity, acceleration and jerk, lower and upper."""

    def __init__(self, limits: Array) -> None:
        self.n, self._limits = len(limits), limits
        import ruckig  # only where it is used, because it loads for long

        self._ruckig, self._solver = ruckig, ruckig.Ruckig(self.n)
        jerk = np.minimum(limits[:, 3, 1], -limits[:, 3, 0])
        self._sides = [*(limits[:, i, side].tolist() for i in (1, 2) for side in (0, 1)), jerk.tolist()]

    def to_state(self, state: Array, goal: Array) -> JointCubics | None:
        """Return the motion from a state (3, n) to a goal (3, n), whose joints end together."""
        answer = self.find(state, goal)
        return None if answer is None else build(state, goal, answer)

    def find(self, state: Array, goal: Array, most: Array | None = None, together: bool = True) -> Any:
        """Return Ruckig's trajectory from a state to a goal, or None; its joints end together, or each at once.

        `most` (2, n) are other limits on the velocity, lower and upper.
        """
        problem = self._problem(state, goal)
        if most is not None:
            problem.min_velocity, problem.max_velocity = most[0].tolist(), most[1].tolist()
        problem.target_position = goal[0].tolist()
        if not together:
            problem.synchronization = self._ruckig.Synchronization.No
        return self._solve(problem)

    def jog(self, state: Array, velocity: Array, hold: float) -> JointCubics | None:
        """Return the motion to a joint velocity (n,), which is stopped `hold` [s] after the start, or at the end of a range."""
        target = np.zeros((3, self.n))
        target[1] = np.clip(velocity, self._limits[:, 1, 0], self._limits[:, 1, 1])
        ramp = self._velocity_phases(state, target)
        if ramp is None:
            return None
        h, j = ramp
        ends = np.minimum(np.cumsum(h, axis=1), hold)
        held = np.diff(np.column_stack([ends, np.full(self.n, hold)]), axis=1, prepend=0.0), np.pad(j, ((0, 0), (0, 1)))
        then = state
        if hold >= SAME_TIME:
            moving = join(state, np.full((3, self.n), np.nan), *held).trajectory
            then = np.stack([moving(moving.end, order) for order in range(3)])
        stop = self._velocity_phases(then, np.zeros((3, self.n)))
        if stop is None:
            return None
        h, j = (np.concatenate(parts, axis=1) for parts in zip(held, stop, strict=True))
        goal = np.zeros((3, self.n))
        goal[0] = np.nan
        motion = join(state, goal, h, j)
        goal[0] = motion.trajectory(motion.end)
        low, high = self._limits[:, 0, 0] + INSIDE, self._limits[:, 0, 1] - INSIDE
        outside = (goal[0] < low) | (goal[0] > high)
        if not outside.any():
            return motion
        # A joint that would leave its range moves to the end of it instead, no faster.
        goal[0] = np.clip(goal[0], low, high)
        most = np.where(outside, np.maximum(np.abs(target[1]), 1e-3), np.inf)
        limit = np.clip(np.stack([-most, most]), self._limits[:, 1, 0], self._limits[:, 1, 1])
        answer = self.find(state, goal, limit, together=False)
        if answer is None:
            return None
        goal[0] = np.nan  # to end exactly there would take a jerk beyond the limit
        for old, new in zip((h, j), _phases(answer), strict=True):
            old[outside], old[outside, : new.shape[1]] = 0.0, new[outside]
        return join(state, goal, h, j)

    def _problem(self, state: Array, goal: Array) -> Any:
        problem = self._ruckig.InputParameter(self.n)
        problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
        problem.target_velocity, problem.target_acceleration = goal[1].tolist(), goal[2].tolist()
        problem.min_velocity, problem.max_velocity, problem.min_acceleration, problem.max_acceleration = self._sides[:4]
        problem.max_jerk = self._sides[4]
        return problem

    def _velocity_phases(self, state: Array, target: Array) -> tuple[Array, Array] | None:
        problem = self._problem(state, target)
        problem.control_interface = self._ruckig.ControlInterface.Velocity
        problem.synchronization = self._ruckig.Synchronization.No
        answer = self._solve(problem)
        return None if answer is None else _phases(answer)

    def _solve(self, problem: Any) -> Any:
        answer = self._ruckig.Trajectory(self.n)
        try:
            result = self._solver.calculate(problem, answer)
        except (self._ruckig.RuckigError, RuntimeError):
            return None
        return answer if result in (self._ruckig.Result.Working, self._ruckig.Result.Finished) else None


def _phases(answer: Any) -> tuple[Array, Array]:
    """Return durations [s] and jerks (n, k) of Ruckig's trajectory."""
    profiles = answer.profiles[0]
    return np.array([p.brake.t + p.t for p in profiles]), np.array([p.brake.j + p.j for p in profiles])


def build(state: Array, goal: Array, answer: Any) -> JointCubics:
    """Return Ruckig's trajectory from a state (3, n) to a goal (3, n), exact at both."""
    return join(state, goal, *_phases(answer))


def join(state: Array, goal: Array, h: Array, j: Array) -> JointCubics:
    """Return the motion of phases of constant jerk, durations h and jerks j (n, k), from a state (3, n) to a goal (3, n)."""
    n, k = h.shape
    knots, count, c = np.zeros((n, 3 * k + 1)), np.zeros(n, dtype=np.int64), np.zeros((n, 4, 3 * k))
    join_phases(h, j, (state, goal), knots, count, c)
    return JointCubics(knots, count, c)
