"""Inverse kinematics by IPOPT through CasADi: joint limits as bounds, the pose as a constraint."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca

from optik.arm.robot import Robot
from optik.check import check_choice, check_kind
from optik.errors import InvalidInput
from optik.ik import _casadi
from optik.ik._casadi import IkAnswer, IkProblem, ProgrammeSolver, SymbolicModel
from optik.ik.base import IKStatus

_RETURN_CODES = {
    "Solve_Succeeded": IKStatus.SOLVED,
    "Solved_To_Acceptable_Level": IKStatus.SOLVED,
    "Maximum_Iterations_Exceeded": IKStatus.MAX_ITERATIONS,
    "Maximum_CpuTime_Exceeded": IKStatus.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": IKStatus.TIME_LIMIT,
    "User_Requested_Stop": IKStatus.TIME_LIMIT,
}
"""Statuses by IPOPT's return code; all other codes mean STALLED."""
FORMS = ("constraint", "least_squares")
"""Values of the option ``form``."""

_OPTIONS: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "acceptable_iter": 0,
    # Measured on the paper's arm: each option saves up to 20 % of the time, with the same results.
    "fast_step_computation": "yes",
    "min_refinement_steps": 0,
    "mumps_scaling": 0,
    "mumps_permuting_scaling": 0,
    "mumps_pivot_order": 0,
    "mumps_mem_percent": 1,
    "nlp_scaling_method": "none",
    "constr_mult_init_max": 0.0,
    "max_soc": 0,
}


class IPOPT(ProgrammeSolver):
    """Inverse kinematics by IPOPT's interior-point method, with the joint limits as hard bounds.

    With ``prefer``, a second programme minimises the preference from the first solution, with the task as constraints.

    Parameters
    ----------
    robot : Robot
        The arm.
    form : {"constraint", "least_squares"}, optional
        The pose error as equality constraints without an objective, or its square as the objective. Measured on the
        paper's arm: constraints take 5 iterations instead of 9 near a solution, and 0.65 of the time; from far away both
        solve as many targets (46 % and 48 % in one attempt). Constraints, the default, need at least as many moving
        joints as the task has components; the default for fewer joints is the square. For redundant arms the square has
        no curvature in the null space, and IPOPT solves 6 of 10 near targets.
    solver_options : mapping, optional
        Options of IPOPT by their own names, in addition to ours.
    **options
        Options of `ProgrammeSolver` (prefer, posture, limit_distance) and of `IKSolver`.
    """

    name: ClassVar[str] = "ipopt"

    def __init__(
        self, robot: Robot, *, form: str | None = None, solver_options: dict[str, Any] | None = None, **options: Any
    ) -> None:
        super().__init__(robot, **options)
        enough = self.task.exact <= self.free_joints
        if form is None:
            form = "constraint" if enough else "least_squares"
        if check_choice(form, "form", FORMS) == "constraint" and not enough:
            given = f"constraint for {self.free_joints} moving joints and {self.task.exact} components"
            raise InvalidInput("form", given, "least_squares: IPOPT takes no more constraints than moving joints")
        check_kind(solver_options, "solver_options", dict | None, 'a dictionary of IPOPT options, e.g. {"tol": 1e-8}')
        self.form = form
        self.solver_options = dict(solver_options or {})
        self._tight = min(self.tolerance.position, self.tolerance.rotation)
        self._build()

    def _problem(self, m: SymbolicModel, choice: bool) -> tuple[str, dict[str, Any], dict[str, Any]]:
        ipopt = _OPTIONS | {"max_iter": self.max_iterations, "constr_viol_tol": 0.1 * self._tight}
        if choice:
            problem = self._second_problem(m)
            ipopt |= {"tol": 1e-6, "mu_init": 1e-4}
        elif self.form == "constraint":
            # Only the constraint must converge, not the barrier.
            problem = {"x": m.q, "p": m.target, "f": ca.SX(0.0), "g": ca.cse(_casadi.error_components(m, self.task))}
            ipopt |= {"tol": 1.0, "dual_inf_tol": 1e3, "compl_inf_tol": 1e3, "mu_init": 1e-2}
        else:  # the gradient of a square vanishes before the error
            problem = {"x": m.q, "p": m.target, "f": ca.cse(_casadi.cost(m, self.task))}
            ipopt |= {"tol": 1e-13, "mu_init": 1e-8}
        options: dict[str, Any] = {"print_time": False, "record_time": False, "error_on_fail": False}
        if not choice and self.form == "constraint" and self.free_joints == self.task.exact == self.task.size:
            options |= {"hess_lag": _gauss_newton_hessian(m, problem, _casadi.cost_derivatives(m, self.task)[2])}
        return "ipopt", problem, {**options, "ipopt": ipopt | self.solver_options}

    def _new_programme(self, choice: bool, watched: bool) -> IkProblem:
        try:
            return super()._new_programme(choice, watched)
        except RuntimeError as error:
            expected = f"options of IPOPT ({_casadi.first_line(error)})"
            raise InvalidInput("solver_options", self.solver_options, expected) from None

    def _status(self, answer: IkAnswer, constrained: bool) -> IKStatus:
        status = _RETURN_CODES.get(answer.code, IKStatus.STALLED)
        if status is IKStatus.SOLVED and not constrained:
            # a local minimum, at which the pose is not necessarily met
            met = answer.f <= 0.5 * (self.tolerance.position**2 + self.tolerance.rotation**2)
            return IKStatus.SOLVED if met else IKStatus.STALLED
        return status


def _gauss_newton_hessian(m: SymbolicModel, problem: dict[str, Any], H: Any) -> ca.Function:
    """Build the Gauss–Newton Hessian, which is cheaper than the exact one, and never indefinite, so IPOPT never corrects it."""
    # With as many equations as moving joints the steps are Newton's for any Hessian. For redundant arms and for least
    # squares, the exact Hessian needs fewer iterations.
    weights = [ca.SX.sym("lam_f"), ca.SX.sym("lam_g", problem["g"].numel() if "g" in problem else 0)]
    inputs, outputs = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
    return ca.Function("hess_lag", [m.q, m.target, *weights], [ca.cse(ca.triu(H))], inputs, outputs)


METHOD = IPOPT
