"""IK as a nonlinear programme for CasADi and IPOPT: joint limits as bounds, the pose as a constraint."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik._casadi.programme import ProgrammeSolver
from optik.ik._casadi.solver import Answer, Programme, first_line
from optik.ik._casadi.symbolic import Model, components, cost, descent
from optik.ik.base import IKStatus

_RETURN_CODES = {
    "Solve_Succeeded": IKStatus.SOLVED,
    "Solved_To_Acceptable_Level": IKStatus.SOLVED,
    "Maximum_Iterations_Exceeded": IKStatus.MAX_ITERATIONS,
    "Maximum_CpuTime_Exceeded": IKStatus.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": IKStatus.TIME_LIMIT,
    "User_Requested_Stop": IKStatus.TIME_LIMIT,
}
"""Status for each return code of IPOPT; every other one means that it stalled."""

FORMS = ("constraint", "least_squares")
"""Values of the option ``form``."""

_OPTIONS: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "acceptable_iter": 0,
    # Measured on the paper's arm: each some percent to 20 % faster, with the same answers.
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
    """The pose by IPOPT's interior-point method, the joint limits as hard bounds; built once and reused.

    With ``prefer``, a second programme from the first one's answer minimises it, the task as its constraints.

    Parameters
    ----------
    robot : Robot
        The arm.
    form : {"constraint", "least_squares"}, optional
        The pose error as equality constraints with nothing to minimise, or its square as the objective. Measured on
        the paper's arm: 5 iterations against 9 near a solution, and 0.65 of the time; from far away the square is solved
        as often (48 % against 46 % in one attempt). By default the constraints, which need as many joints
        that move as the task has components; the square for arms with fewer. With more (seven joints and a full pose)
        the square has no curvature along the free motion, and IPOPT solves 6 in 10 of those near the start.
    solver_options : mapping, optional
        Options of IPOPT by their own names, added to ours.
    **options
        Those of `ProgrammeSolver` (prefer, posture, limit_distance) and of `IKSolver`.
    """

    name: ClassVar[str] = "ipopt"

    def __init__(
        self, robot: Robot, *, form: str | None = None, solver_options: dict[str, Any] | None = None, **options: Any
    ) -> None:
        super().__init__(robot, **options)
        enough = self.task.exact <= self.free_joints
        if form is None:
            form = "constraint" if enough else "least_squares"
        if form not in FORMS:
            raise InvalidInput("form", repr(form), " or ".join(FORMS))
        if form == "constraint" and not enough:
            came = f"constraint for {self.free_joints} moving joints and {self.task.exact} components"
            raise InvalidInput("form", came, "least_squares: IPOPT takes no more constraints than joints that move")
        if not isinstance(solver_options, dict | None):
            raise InvalidInput("solver_options", repr(solver_options)[:60], "a dictionary of IPOPT's options")
        self.form = form
        self.solver_options = dict(solver_options or {})
        self._tight = min(self.tolerance.position, self.tolerance.rotation)
        self._build()

    @property
    def options(self) -> dict[str, Any]:
        """All options, as they would be given again."""
        return {**super().options, "form": self.form, "solver_options": self.solver_options}

    def _problem(self, m: Model, choice: bool) -> tuple[str, dict[str, Any], dict[str, Any]]:
        ipopt = _OPTIONS | {"max_iter": self.max_iterations, "constr_viol_tol": 0.1 * self._tight}
        if choice:
            problem = self._chosen(m)
            ipopt |= {"tol": 1e-6, "mu_init": 1e-4}
        elif self.form == "constraint":
            # Only the constraint must converge, not the barrier.
            problem = {"x": m.q, "p": m.target, "f": ca.SX(0.0), "g": ca.cse(components(m, self.task))}
            ipopt |= {"tol": 1.0, "dual_inf_tol": 1e3, "compl_inf_tol": 1e3, "mu_init": 1e-2}
        else:  # the gradient of a square vanishes before the error does
            problem = {"x": m.q, "p": m.target, "f": ca.cse(cost(m, self.task))}
            ipopt |= {"tol": 1e-13, "mu_init": 1e-8}
        options: dict[str, Any] = {"print_time": False, "record_time": False, "error_on_fail": False}
        if not choice and self.form == "constraint" and self.free_joints == self.task.exact == self.task.size:
            options |= {"hess_lag": _curvature(m, problem, descent(m, self.task)[2])}
        return "ipopt", problem, {**options, "ipopt": ipopt | self.solver_options}

    def _new_programme(self, choice: bool, watched: bool) -> Programme:
        try:
            return super()._new_programme(choice, watched)
        except RuntimeError as error:
            expected = f"options that IPOPT knows ({first_line(error)})"
            raise InvalidInput("solver_options", self.solver_options, expected) from None

    def _status(self, answer: Answer, constrained: bool) -> IKStatus:
        status = _RETURN_CODES.get(answer.code, IKStatus.STALLED)
        if status is IKStatus.SOLVED and not constrained:
            # this is a local minimum, but the pose may not be met there
            met = answer.f <= 0.5 * (self.tolerance.position**2 + self.tolerance.rotation**2)
            return IKStatus.SOLVED if met else IKStatus.STALLED
        return status


def _curvature(m: Model, problem: dict[str, Any], H: Any) -> ca.Function:
    """A Gauss–Newton Hessian in place of the exact one: cheaper, and never indefinite, so that IPOPT never corrects it."""
    # With as many equations as joints that move the steps are Newton's, whatever the Hessian is. Where the task leaves a
    # motion free, or for least squares, the exact one needs fewer iterations.
    weights = [ca.SX.sym("lam_f"), ca.SX.sym("lam_g", problem["g"].numel() if "g" in problem else 0)]
    inputs, outputs = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
    return ca.Function("hess_lag", [m.q, m.target, *weights], [ca.cse(ca.triu(H))], inputs, outputs)


METHOD = IPOPT
