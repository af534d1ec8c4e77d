"""An IK method in one file: Jacobian transpose, Δq = α Jᵀ e, with steps α after Barzilai and Borwein (1988).

Try it: ``optik ik --solver examples/plugins/jt.py --xyz 0.1,0.3,0.2``.
"""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.ik.base import Attempt, IKSolver, IKStatus
from optik.kinematics import frames, jacobian_from, tool_pose
from optik.linear import copy_vector
from optik.se3 import pose_error


@compiled
def descend(chain, limits, target, tolerance, q, errors, most):
    """Iterate q (n,) [rad, m] in place, and store the errors (k, 6) [m, rad] if they have rows; return (iterations, solved)."""
    n = q.size
    frame, T, J, e = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n)), np.empty(6)
    before, gradient_before, gradient = q.copy(), np.zeros(n), np.zeros(n)
    for k in range(most + 1):
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        pose_error(T, target, e)
        if errors.shape[0] > 0:
            copy_vector(e, errors[k])
        if (
            max(abs(e[0]), abs(e[1]), abs(e[2])) <= tolerance[0]
            and max(abs(e[3]), abs(e[4]), abs(e[5])) <= tolerance[1]
        ):
            return k, True
        if k == most:
            break
        jacobian_from(chain, frame, T, J)
        moved, changed, steepest = 0.0, 0.0, 0.0  # Δq·Δg, Δg·Δg and g·g, with the gradient g = Jᵀ e
        for i in range(n):
            gradient[i] = 0.0
            for r in range(6):
                gradient[i] += J[r, i] * e[r]
            dg = gradient_before[i] - gradient[i]
            moved += (q[i] - before[i]) * dg
            changed += dg * dg
            steepest += gradient[i] * gradient[i]
        if k > 0 and moved > 0.0:
            step = moved / changed
        else:
            back = 0.0  # |J g|²: the step that reduces |e| most where the arm is taken as linear
            for r in range(6):
                along = 0.0
                for i in range(n):
                    along += J[r, i] * gradient[i]
                back += along * along
            step = steepest / max(back, 1e-30)
        copy_vector(q, before)
        copy_vector(gradient, gradient_before)
        for i in range(n):
            q[i] = min(max(q[i] + step * gradient[i], limits[0][i]), limits[1][i])
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

    def __init__(self, robot, *, max_iterations=2000, **options):
        super().__init__(robot, max_iterations=max_iterations, **options)
        self._limits = robot.limits.lower, robot.limits.upper
        # of one component of the errors, whose norms are at most √3 times as large
        self._tolerance = 0.5 * self.tolerance.position, 0.5 * self.tolerance.rotation

    def attempt(self, target, start, trace, time_limit):
        """Iterate from the initial guess (n,) [rad, m]; `IKSolver.solve` judges the result."""
        q = self.robot.limits.clip(start)
        errors = np.empty((self.max_iterations + 1 if trace else 0, 6))
        k, solved = descend(self.robot.chain, self._limits, target, self._tolerance, q, errors, self.max_iterations)
        status = IKStatus.SOLVED if solved else IKStatus.MAX_ITERATIONS
        return Attempt(q, status, k, errors[: k + 1].copy() if trace else None)


METHOD = JacobianTranspose
