"""An IK method in one file: Jacobian transpose, Δq = α Jᵀ e, with steps α after Barzilai and Borwein (1988).

    optik ik --solver examples/jt.py --xyz 0.1 0.3 0.2

"""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.ik.base import Attempt, IKSolver, IKStatus
from optik.kinematics import frames, jacobian_from, tool_pose
from optik.se3 import pose_error


@compiled
def descend(arm, target, tolerance, q, errors, most):
    """Run from q (n,) [rad, m] in place, errors (k, 6) [m, rad] kept where they have rows; return (iterations, solved)."""
    fixed, prismatic, tool, lower, upper = arm
    n = q.size
    frame, T, J, e = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n)), np.empty(6)
    before, gradient_before, gradient = q.copy(), np.zeros(n), np.zeros(n)
    for k in range(most + 1):
        frames(fixed, prismatic, q, frame)
        tool_pose(frame, tool, T)
        pose_error(T, target, e)
        if errors.shape[0] > 0:
            errors[k] = e
        if np.sqrt(e[:3] @ e[:3]) <= tolerance[0] and np.sqrt(e[3:] @ e[3:]) <= tolerance[1]:
            return k, True
        if k == most:
            break
        jacobian_from(frame, prismatic, T, J)
        gradient[:] = J.T @ e
        dq, dg = q - before, gradient_before - gradient
        along = dq @ dg
        if k > 0 and along > 0.0:
            step = along / (dg @ dg) if k % 2 else (dq @ dq) / along
        else:  # the step that reduces |e| most where the arm is taken as linear
            back = J @ gradient
            step = (gradient @ gradient) / max(back @ back, 1e-30)
        before[:], gradient_before[:] = q, gradient
        for i in range(n):
            q[i] = min(max(q[i] + step * gradient[i], lower[i]), upper[i])
    return most, False


class JacobianTranspose(IKSolver):
    """Jacobian transpose: no matrix is inverted, so it passes singular configurations, in many cheap iterations.

    Parameters
    ----------
    robot : Robot
        The arm.
    max_iterations : int
        Of one attempt.
    **options
        Those of `IKSolver`.
    """

    takes_tasks = False

    def __init__(self, robot, *, max_iterations=1000, **options):
        super().__init__(robot, max_iterations=max_iterations, **options)
        limits = robot.limits
        self._arm = robot.fixed, robot.prismatic, robot.tool, limits.lower, limits.upper
        self._tolerance = np.array([self.tolerance.position, self.tolerance.rotation])

    def attempt(self, target, start, trace, seconds):
        """Try once from the start (n,) [rad, m]; the answer is judged by `IKSolver.solve`."""
        q = self.robot.limits.clip(start)
        errors = np.empty((self.max_iterations + 1 if trace else 0, 6))
        k, solved = descend(self._arm, target, self._tolerance, q, errors, self.max_iterations)
        status = IKStatus.SOLVED if solved else IKStatus.MAX_ITERATIONS
        return Attempt(q, status, k, errors[: k + 1].copy() if trace else None)


METHOD = JacobianTranspose
