"""Inverse kinematics by CasADi's SQP method, with a Gauss–Newton Hessian and the joint limits as bounds."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca

from optik.arm.robot import Robot
from optik.ik._casadi import IkAnswer, ProgrammeSolver, SymbolicModel, cost_derivatives
from optik.ik.base import IKStatus

_QUIET = {"print_time": False, "print_header": False, "print_iteration": False, "print_status": False}
_QUIET_QP = {"print_header": False, "print_iter": False, "print_info": False, "print_lincomb": False}
"""Options that silence the SQP method and its QP solver."""


class SQP(ProgrammeSolver):
    """Least squares of the pose error by CasADi's ``sqpmethod`` and its active-set QP solver ``qrqp``.

    It minimises E = ½ Σ e² inside the joint limits with the Hessian JᵀJ + c·E·I and full steps; the damping by E replaces
    the line search. It ends when the gradient is below a hundredth of the tolerance: either the pose is met, or a local
    minimum gives the status STALLED. With ``prefer``, a second programme minimises the preference, with the task as
    constraints and a convexified exact Hessian.

    Parameters
    ----------
    robot : Robot
        The arm.
    **options
        Options of `ProgrammeSolver` (prefer, posture, limit_distance) and of `IKSolver`.
    """

    name: ClassVar[str] = "sqp"

    def __init__(self, robot: Robot, *, max_iterations: int = 50, **options: Any) -> None:
        super().__init__(robot, max_iterations=max_iterations, **options)
        self._tight = min(self.tolerance.position, self.tolerance.rotation)
        self._build()

    def _problem(self, m: SymbolicModel, choice: bool) -> tuple[str, dict[str, Any], dict[str, Any]]:
        options: dict[str, Any] = {
            **_QUIET,
            "error_on_fail": False,
            "record_time": False,
            "qpsol": "qrqp",
            "qpsol_options": {**_QUIET_QP, "print_time": False, "record_time": False, "error_on_fail": False},
            "max_iter": self.max_iterations,
            "tol_pr": 0.1 * self._tight,
            "min_step_size": 0.0,
        }
        if choice:
            options |= {"tol_du": 1e-6, "max_iter_ls": 10, "convexify_strategy": "eigen-clip"}
            return "sqpmethod", self._second_problem(m), options
        f, slope, H = (ca.cse(part) for part in cost_derivatives(m, self.task))
        n, weights = self.robot.n, [ca.SX.sym("lam_f"), ca.SX.sym("lam_g", 0)]
        options |= {
            "tol_du": 1e-2 * self._tight,
            "max_iter_ls": 0,
            "jac_fg": ca.Function(
                "jac_fg",
                [m.q, m.target],
                [f, slope, ca.SX(0, 1), ca.SX(0, n)],
                ["x", "p"],
                ["f", "grad_f_x", "g", "jac_g_x"],
            ),
            "hess_lag": ca.Function(
                "hess_lag", [m.q, m.target, *weights], [H], ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"]
            ),
        }
        return "sqpmethod", {"x": m.q, "p": m.target, "f": f}, options

    def _status(self, answer: IkAnswer, constrained: bool) -> IKStatus:
        if answer.f <= 0.5 * (self.tolerance.position**2 + self.tolerance.rotation**2):
            return IKStatus.SOLVED
        if answer.code == "User_Requested_Stop":
            return IKStatus.TIME_LIMIT
        return IKStatus.MAX_ITERATIONS if answer.code == "Maximum_Iterations_Exceeded" else IKStatus.STALLED


METHOD = SQP
