"""Damped least squares of the paper (eq. 6–13): error feedback, a step size, and steps clamped to the limits."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_flag, check_number
from optik.compiled import compiled
from optik.ik.base import Attempt, IKSolver
from optik.ik.problem import MAX_ITERATIONS, SOLVED, STALLED, STATUS_OF_CODE
from optik.kinematics import Chain, Range, forward, jacobian_from, squares, workspace
from optik.linear import copy_vector, damped_step
from optik.se3 import pose_error
from optik.task import Goal, task_error, task_system, whole_pose
from optik.types import Array

_ENDINGS = {
    SOLVED: "error within the tolerance",
    MAX_ITERATIONS: "maximum number of iterations",
    STALLED: "J Jᵀ is singular and there is no damping; try damping=0.01",
}
"""Messages by status code."""


@compiled
def iterate(
    chain: Chain, limits: Range, goal: Goal, options: Array, max_iterations: int, q: Array, best: Array, trace: Array
) -> tuple[int, int]:  # fmt: skip
    """Run eq. 8–13 from q, and return the number of iterations and the status code; best becomes the best iterate.

    Shapes and units: options (5,) [m, rad], q (n,) [rad, m] (overwritten), best (n,) [rad, m] (overwritten), trace
    (max_iterations + 1, 6) or (0, 6) [m, rad] (overwritten).
    """
    n, (flags, target), (lower, upper), (frame, T, J) = q.shape[0], goal, limits, workspace(chain, q.shape[0])
    A, y, dq, e, w = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6), np.empty(3)
    pose, smallest, k = whole_pose(flags), np.inf, 0
    while True:
        forward(chain, q, frame, T)
        if pose:  # Δp = p_t − p, Δω = log(R_t Rᵀ): eq. 8, 10 and eq. 9 corrected
            pose_error(T, target, e)
        else:
            task_error(T, target, flags, e, w)
        p2, r2 = squares(e)
        if trace.shape[0] > 0:
            copy_vector(e, trace[k])
        met = p2 <= options[2] * options[2] and r2 <= options[3] * options[3]
        if met or p2 + r2 < smallest:
            smallest = p2 + r2
            copy_vector(q, best)
        if met:
            return k, SOLVED
        if k == max_iterations:
            return k, MAX_ITERATIONS
        if options[4] != 0.0:  # eq. 9 as printed: R R_tᵀ, the opposite rotation
            e[3], e[4], e[5] = -e[3], -e[4], -e[5]
        jacobian_from(chain, frame, T, J)
        m = 6 if pose else task_system(target, flags, w, J, e)
        if not damped_step(J[:m], e[:m], options[0] * options[0], A, y[:m], dq):  # eq. 11
            return k, STALLED
        for i in range(n):  # eq. 12 with its α, eq. 13, and the limits
            q[i] = min(max(q[i] + options[1] * dq[i], lower[i]), upper[i])
        k += 1


class DLS(IKSolver):
    """Damped least squares of the paper: Δq = α Jᵀ (J Jᵀ + λ² I)⁻¹ Δx, clamped to the joint limits.

    There are no restarts by default. ``trace[k]`` is the error of a run with ``max_iterations=k``.

    Parameters
    ----------
    robot : Robot
        The arm.
    damping : float
        λ of eq. 11, ≥ 0. Position errors in metres and rotation errors in radians have equal weights.
    step : float
        α of eq. 12, above 0.
    as_printed : bool
        Whether to use eq. 9 as printed, ΔR = R R_tᵀ, which turns the tool away from the target: for study only.
    **options
        Options of `IKSolver`.
    """

    name: ClassVar[str] = "dls"

    def __init__(
        self, robot: Robot, *, damping: float = 0.01, step: float = 1.0, as_printed: bool = False, **options: Any
    ) -> None:
        super().__init__(robot, **options)
        self.damping = check_number(damping, "damping", "a finite number ≥ 0", least=0.0)
        self.step = check_number(step, "step", "a finite number above 0", above=0.0)
        self.as_printed = check_flag(as_printed, "as_printed")
        self._numbers = np.array(
            [self.damping, self.step, self.tolerance.position, self.tolerance.rotation, float(self.as_printed)]
        )

    def attempt(self, target: Array, start: Array, trace: bool, time_limit: float | None) -> Attempt:
        """Run the iteration once; it is so short that the time limit is checked only between attempts."""
        robot, limits = self.robot, self.robot.limits
        q, best = limits.clip(start), np.empty(robot.n)
        errors = np.empty((self.max_iterations + 1 if trace else 0, 6))
        k, code = iterate(
            robot.chain, (limits.lower, limits.upper), (self.task.flags, target),
            self._numbers, self.max_iterations, q, best, errors,
        )  # fmt: skip
        kept = errors[: k + 1].copy() if trace else None
        return Attempt(best, STATUS_OF_CODE[code], k, kept, _ENDINGS[code])


METHOD = DLS
