"""The paper's Jacobian iteration: damped least squares with error feedback, a step size and clamping (eq. 6–13)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_flag, check_number
from optik.compiled import compiled
from optik.ik.base import Attempt, IKSolver, IKStatus
from optik.kinematics import Chain, copy_vector, frames, jacobian_from, tool_pose
from optik.linear import damped_step
from optik.se3 import pose_error
from optik.task import keep_rows, task_error, task_rows
from optik.types import Array

_SOLVED, _MAX_ITERATIONS, _SINGULAR = 0, 1, 2


@compiled
def iterate(
    chain: Chain,
    lower: Array,
    upper: Array,
    flags: Array,
    target: Array,
    options: Array,
    max_iterations: int,
    q: Array,
    best: Array,
    trace: Array,
) -> tuple[int, int]:
    """Run eq. 8–13 from q (n,) in place; the iterate of smallest error into best; errors into trace, if it has rows.

    options holds (damping λ, step α, position and rotation tolerance, 1 where eq. 9 is taken as printed).
    Returns (iterations, how it ended).
    """
    damping, step, tolerance_p, tolerance_r, as_printed = options[0], options[1], options[2], options[3], options[4]
    n = q.shape[0]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    A, y, dq, e = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6)
    w = np.empty(3)
    pose = True
    for i in range(6):  # all of the pose, and no box
        pose = pose and flags[i] == 1.0 and flags[7 + i] == 0.0
    smallest = np.inf
    k = 0
    while True:
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        if pose:
            pose_error(T, target, e)  # Δp = p_t − p, Δω = log(R_t Rᵀ): eq. 8, 10 and eq. 9 corrected
        else:
            task_error(T, target, flags, e, w)
        if trace.shape[0] > 0:
            copy_vector(e, trace[k])
        p2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
        r2 = e[3] * e[3] + e[4] * e[4] + e[5] * e[5]
        if p2 + r2 < smallest:
            smallest = p2 + r2
            copy_vector(q, best)
        if p2 <= tolerance_p * tolerance_p and r2 <= tolerance_r * tolerance_r:
            copy_vector(q, best)
            return k, _SOLVED
        if k == max_iterations:
            return k, _MAX_ITERATIONS
        if as_printed != 0.0:  # eq. 9 as printed: R R_tᵀ, the opposite rotation
            e[3], e[4], e[5] = -e[3], -e[4], -e[5]
        jacobian_from(chain, frame, T, J)
        m = 6
        if not pose:
            task_rows(target, flags, w, J)
            m = keep_rows(flags, J, e)
        if not damped_step(J[:m], e[:m], damping * damping, A, y[:m], dq):  # eq. 11
            return k, _SINGULAR
        for i in range(n):  # eq. 12 with its α, eq. 13, and the limits
            q[i] = min(max(q[i] + step * dq[i], lower[i]), upper[i])
        k += 1


_STATUS = {
    _SOLVED: (IKStatus.SOLVED, "error within the tolerance"),
    _MAX_ITERATIONS: (IKStatus.MAX_ITERATIONS, "maximum number of iterations"),
    _SINGULAR: (IKStatus.STALLED, "J Jᵀ is singular and there is no damping; try damping=0.01"),
}


class DLS(IKSolver):
    """Damped least squares, the paper's iteration: Δq = α Jᵀ (J Jᵀ + λ² I)⁻¹ Δx, clamped to the joint limits.

    No restarts unless asked. The error of the run stopped after k iterations is ``trace[k]`` of a longer one.

    Parameters
    ----------
    robot : Robot
        The arm.
    damping : float
        λ of eq. 11, ≥ 0. Position errors count in metres and rotation errors in radians, with equal weight.
    step : float
        α of eq. 12, above 0.
    as_printed : bool
        Take eq. 9 as it is printed, ΔR = R R_tᵀ, which turns the tool away from the target: for study only.
    **options
        Those of `IKSolver`.
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

    @property
    def options(self) -> dict[str, Any]:
        """All options, as they would be given again."""
        return {**super().options, "damping": self.damping, "step": self.step, "as_printed": self.as_printed}

    def attempt(self, target: Array, start: Array, trace: bool, seconds: float | None) -> Attempt:
        """Iterate once from the start; so short that a time limit is only looked at between attempts."""
        robot, limits = self.robot, self.robot.limits
        q, best = limits.clip(start), np.empty(robot.n)
        errors = np.empty((self.max_iterations + 1 if trace else 0, 6))
        k, code = iterate(
            robot.chain, limits.lower, limits.upper,
            self.task.flags, target, self._numbers, self.max_iterations, q, best, errors,
        )  # fmt: skip
        status, message = _STATUS[code]
        return Attempt(best, status, k, errors[: k + 1].copy() if trace else None, message)


METHOD = DLS
