"""IK as a nonlinear programme for CasADi and IPOPT: joint limits as bounds, the pose as a constraint."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from optik.errors import InvalidInput
from optik.ik._casadi import residual, target_parameters
from optik.ik.base import Attempt, IKSolver, IKStatus
from optik.robot import Robot

Array = NDArray[np.float64]

_STATUS = {
    "Solve_Succeeded": IKStatus.SOLVED,
    "Solved_To_Acceptable_Level": IKStatus.SOLVED,
    "Maximum_Iterations_Exceeded": IKStatus.MAX_ITERATIONS,
    "Maximum_CpuTime_Exceeded": IKStatus.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": IKStatus.TIME_LIMIT,
}

FORMS = ("constraint", "least_squares")


class IPOPT(IKSolver):
    """The pose by IPOPT's interior-point method, the joint limits as hard bounds; built once and reused.

    Parameters
    ----------
    robot : Robot
        The arm.
    form : {"constraint", "least_squares"}, optional
        The pose error as six equality constraints with nothing to minimise, or its square as the objective. Measured on
        the paper's arm: 4 iterations against 8 near a solution, and 0.75 of the time; from far away the square is solved
        a little more often (57 % against 49 % in one attempt). By default the constraints, which need six joints; the
        square for arms with fewer.
    solver_options : mapping, optional
        Options of IPOPT by their own names, added to ours.
    **options
        Those of `IKSolver`.
    """

    name: ClassVar[str] = "ipopt"

    def __init__(
        self, robot: Robot, *, form: str | None = None, solver_options: dict[str, Any] | None = None, **options: Any
    ) -> None:
        super().__init__(robot, **options)
        if form is None:
            form = "constraint" if robot.n >= 6 else "least_squares"
        if form not in FORMS:
            raise InvalidInput("form", repr(form), " or ".join(FORMS))
        if form == "constraint" and robot.n < 6:
            raise InvalidInput(
                "form", f"constraint for {robot.n} joints", "least_squares: IPOPT takes no more constraints than joints"
            )
        if not isinstance(solver_options, dict | None):
            raise InvalidInput("solver_options", repr(solver_options)[:60], "a dictionary of IPOPT's options")
        self.form = form
        self.solver_options = dict(solver_options or {})
        self._square = self.tolerance.position**2 + self.tolerance.rotation**2
        self._iterates = _Iterates(robot.n, 6 if form == "constraint" else 0)
        self._solver  # noqa: B018  (built now, so that the first solve is not slower than the rest)

    @property
    def options(self) -> dict[str, Any]:
        """All options, as they would be given again."""
        return {**super().options, "form": self.form, "solver_options": self.solver_options}

    def _build(self, callback: ca.Callback | None) -> ca.Function:
        q, target = ca.SX.sym("q", self.robot.n), ca.SX.sym("target", 7)
        e = residual(self.robot, q, target)
        problem = {"x": q, "p": target}
        if self.form == "constraint":
            problem |= {"f": ca.SX(0.0), "g": e}
        else:
            problem |= {"f": ca.dot(e, e)}
        ipopt: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "max_iter": self.max_iterations,
            # The judgement is ours; IPOPT is asked for a little more, so that it does not stop just short of it.
            "tol": 1e-9,
            "constr_viol_tol": 0.1 * min(self.tolerance.position, self.tolerance.rotation),
            "acceptable_iter": 0,
            # Measured on the paper's arm: 10 to 20 % faster each, with the same answers.
            "fast_step_computation": "yes",
            "min_refinement_steps": 0,
        }
        if self.form == "least_squares":  # the gradient of a square vanishes before the error does
            ipopt |= {"tol": 1e-13, "mu_init": 1e-8}
        if self.time_limit is not None:
            ipopt["max_wall_time"] = self.time_limit
        options: dict[str, Any] = {"print_time": False, "error_on_fail": False, "ipopt": ipopt | self.solver_options}
        if callback is not None:
            options["iteration_callback"] = callback
        try:
            return ca.nlpsol("ik", "ipopt", problem, options)
        except RuntimeError as error:
            raise InvalidInput(
                "solver_options", self.solver_options, f"options that IPOPT knows ({_first_line(error)})"
            ) from None

    @cached_property
    def _solver(self) -> ca.Function:
        return self._build(None)

    @cached_property
    def _traced(self) -> ca.Function:
        return self._build(self._iterates)

    def attempt(self, target: Array, start: Array, trace: bool, seconds: float | None) -> Attempt:
        """Solve once from the start. IPOPT moves the start a little inside the bounds before its first iteration."""
        solver = self._traced if trace else self._solver
        self._iterates.seen.clear()
        limits = self.robot.limits
        bounds = {"lbg": 0.0, "ubg": 0.0} if self.form == "constraint" else {}
        answer = solver(x0=start, p=target_parameters(target), lbx=limits.lower, ubx=limits.upper, **bounds)
        stats = solver.stats()
        q = np.asarray(answer["x"], dtype=np.float64).ravel()
        code = str(stats["return_status"])
        errors = None
        if trace:
            # iterate 0 is the start as it was given; IPOPT reports the last one twice
            visited = np.array([start, *self._iterates.seen[1:]])[: int(stats["iter_count"]) + 1]
            errors = self.robot.errors(visited, target)
        status = _STATUS.get(code, IKStatus.STALLED)
        if self.form == "least_squares" and status is IKStatus.SOLVED and float(answer["f"]) > self._square:
            status = IKStatus.STALLED  # IPOPT is right that this is a minimum, but the pose is not met there
        # IPOPT relaxes bounds by 1e-8; ours are hard.
        return Attempt(limits.clip(q), status, int(stats["iter_count"]), errors, f"IPOPT: {code}")


class _Iterates(ca.Callback):
    """Keeps every iterate that IPOPT reports."""

    def __init__(self, variables: int, constraints: int) -> None:
        super().__init__()
        self._sizes = {"x": variables, "f": 1, "g": constraints, "lam_x": variables, "lam_g": constraints}
        self.seen: list[Array] = []
        self.construct("iterates", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes.get(ca.nlpsol_out(i), 0), 1)

    def eval(self, arguments: Any) -> list[int]:
        self.seen.append(np.asarray(arguments[0], dtype=np.float64).ravel())
        return [0]


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[-1][:120]


METHOD = IPOPT
