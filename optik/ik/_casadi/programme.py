"""Base class of the CasADi methods: solvers called through buffers, tightened limits, a second programme for a preference."""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LIMIT_TOLERANCE, JointLimits
from optik.arm.robot import Robot
from optik.check import check_number
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.ik._casadi.symbolic import Model, build_model, error_components, pose_parameters, preference_cost, task_rows
from optik.ik._null_space import Preference
from optik.ik.base import Attempt, IKResult, IKSolver, IKStatus
from optik.se3 import is_pose
from optik.task import judge
from optik.types import Array

_FLOAT = np.dtype(np.float64)
"""Type of arrays that need no conversion: a comparison with np.float64 itself takes three times as long."""


class IkAnswer(NamedTuple):
    """Output of a solver: last iterate (n,) [rad, m], objective there, return code, iterations, and the recorded iterates (n,).

    The last iterate is clamped to the bounds, which IPOPT relaxes by 1e-8.
    """

    q: Array
    f: float
    code: str
    iterations: int
    visited: list[Array]


class IkProblem:
    """CasADi solver called through its buffers: the arrays are set once, and a call converts nothing."""

    def __init__(
        self, function: ca.Function, limits: JointLimits, bounds: JointLimits, box: Array, watch: Watch | None
    ) -> None:
        self._function, self._watch, self.constrained = function, watch, box.size > 0
        buffer: Any
        buffer, self._call = function.buffer()
        self._buffer = buffer
        self._in: dict[str, Any] = {
            name: np.zeros(function.numel_in(name)) for name in ("x0", "p", "lbx", "ubx", "lbg", "ubg")
        }
        self._out: dict[str, Any] = {name: np.zeros(function.numel_out(name)) for name in ("x", "f")}
        for name, array in self._in.items():
            if array.size:
                buffer.set_arg(function.index_in(name), memoryview(array))
        for name, array in self._out.items():
            buffer.set_res(function.index_out(name), memoryview(array))
        self._in["lbx"][:], self._in["ubx"][:] = bounds.lower, bounds.upper
        self._in["lbg"][:], self._in["ubg"][:] = -box, box
        self._x0, self._p = self._in["x0"], self._in["p"]
        self._limits = np.array([limits.lower, limits.upper, bounds.lower, bounds.upper])

    def solve_arrays(self, target: Any, q0: Any) -> IkAnswer | None:
        """Solve for a target and an initial guess if both are valid float64 arrays; otherwise return None."""
        if not (type(target) is type(q0) is np.ndarray and target.dtype == q0.dtype == _FLOAT):
            return None
        if not (target.shape == (4, 4) and q0.shape == self._x0.shape and target.flags.carray and q0.flags.carray):
            return None
        return self._run(np.inf) if load_problem(target, q0, self._limits, self._x0, self._p) else None

    def solve(self, start: Array, parameters: Array, end: float) -> IkAnswer:
        """Solve from an initial guess, which is clamped to the bounds, until the clock time `end`."""
        clamp(start, self._in["lbx"], self._in["ubx"], self._in["x0"])
        self._in["p"][:] = parameters
        return self._run(end)

    def _run(self, end: float) -> IkAnswer:
        if self._watch is not None:
            self._watch.begin(end)
        try:
            self._call()
            stats = self._buffer.stats()
            code, count = stats["return_status"], stats["iter_count"]
        except (RuntimeError, KeyError) as error:  # exceptions of CasADi do not leave this module
            return IkAnswer(self._in["x0"].copy(), np.inf, first_line(error), 0, [])
        q = np.empty(self._in["x0"].size)
        clamp(self._out["x"], self._in["lbx"], self._in["ubx"], q)
        visited: list[Array] = []
        if self._watch is not None:
            # iterate 0 is the initial guess; the last may be reported twice, or (after a restoration) not at all
            before = self._watch.iterates[1:count]
            visited = [*before, *[q] * (count - len(before))]
        return IkAnswer(q, self._out["f"].item(), code, count, visited)


@compiled
def clamp(q: Array, lower: Array, upper: Array, out: Array) -> None:
    """Write a configuration clamped to bounds into out; NaN stays.

    Shapes and units: q (n,) [rad, m], lower, upper (n,) [rad, m], out (n,) [rad, m] (overwritten).
    """
    for i in range(q.shape[0]):
        x = q[i]
        out[i] = upper[i] if x > upper[i] else (lower[i] if x < lower[i] else x)


@compiled
def load_problem(target: Array, q0: Array, limits: Array, x0: Array, parameters: Array) -> bool:
    """Write a target and an initial guess into the input of a programme; return False if one is invalid.

    Shapes and units: target (4, 4) [1, m], q0 (n,) [rad, m], limits (4, n) [rad, m], x0 (n,) [rad, m] (overwritten), parameters
    (m,) [1, m] (overwritten).
    """
    if not is_pose(target):
        return False
    for i in range(x0.shape[0]):
        if not (limits[0, i] - LIMIT_TOLERANCE <= q0[i] <= limits[1, i] + LIMIT_TOLERANCE and abs(q0[i]) < np.inf):
            return False
        x0[i] = min(max(q0[i], limits[2, i]), limits[3, i])
    for i in range(12):
        parameters[i] = target[i // 4, i % 4]
    return True


class Watch(ca.Callback):
    """Callback that records every iterate of a solver, and stops the solver at its time limit."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        super().__init__()
        x, g, p = sizes["x"], sizes.get("g", 0), sizes["p"]
        self._sizes = {"x": x, "f": 1, "g": g, "lam_x": x, "lam_g": g, "lam_p": p}
        self.iterates: list[Array] = []
        self._end = np.inf
        self.construct("watch", {})

    def begin(self, end: float) -> None:
        """Clear the iterates, and set the clock time at which the solver is stopped."""
        self.iterates.clear()
        self._end = end

    def get_n_in(self) -> int:
        """Return the number of inputs: the results of a solver."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return the number of outputs, which is one: the request to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Return the name of a result of the solver."""
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return the shape of a result of the solver."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arguments: Any) -> list[int]:
        """Record an iterate, and return whether to stop."""
        self.iterates.append(np.asarray(arguments[0], dtype=np.float64).ravel())
        return [int(time.perf_counter() >= self._end)]


def first_line(error: Exception) -> str:
    """Return the message of a CasADi exception without the location in CasADi's source."""
    return str(error).strip().splitlines()[-1][:120]


# Attribute look-ups would take a microsecond per call.
_solved, _new = IKStatus.SOLVED, tuple.__new__


class ProgrammeSolver(IKSolver):
    """Inverse kinematics as nonlinear programmes: first the pose, then a preference in the null space.

    Parameters
    ----------
    robot : Robot
        The arm.
    prefer : str or mapping of name to weight, optional
        Secondary objective ``"posture"``, ``"limits"``, ``"manipulability"``, or a mapping of these names to weights, as
        in `LM`. The weighted sum is minimised in the null space, from the configuration that meets the pose to a local
        minimum. Without redundancy (six joints and a complete pose) it has no effect, and ``message`` says so.
    posture : (n,) array, optional
        Posture of ``"posture"`` [rad, m], by default `q0`.
    limit_distance : float
        Least distance of every joint from its position limits [rad, m]; locked joints stay in place. An initial guess
        that is nearer is moved inwards.
    **options
        Options of `IKSolver`.

    Raises
    ------
    InvalidInput
        An option out of range, an unknown preference, or a distance above half the range of a joint.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        prefer: str | Mapping[str, float] | None = None,
        posture: ArrayLike | None = None,
        limit_distance: float = 0.0,
        **options: Any,
    ) -> None:
        super().__init__(robot, **options)
        self.preference = Preference.from_options(robot, prefer, posture)
        vars(self).update(self.preference.options)
        self.limit_distance = check_number(limit_distance, "limit_distance", "a distance ≥ 0 [rad, m]", least=0.0)
        self.bounds = _tighten_limits(robot, self.limit_distance)
        self.free_joints = int((self.bounds.lower < self.bounds.upper).sum())
        self._parameters = np.zeros(12 + robot.n)
        self._quick = self.time_limit is None and not self.has_second_stage and robot.motors is None
        self._limits = robot.limits.lower, robot.limits.upper
        self._position, self._rotation = self.tolerance.position, self.tolerance.rotation
        self._prefix = f"{self.name.upper()}: "
        note = self.preference.explain(self.task, self.free_joints)
        self._suffix = f"; {note}" if note else ""
        self._first: IkAnswer | None = None
        self._lock = threading.RLock()
        self._programme = cache(self._new_programme)

    @property
    def has_second_stage(self) -> bool:
        """Whether there is a preference and the arm is redundant for the task."""
        return bool(self.preference) and self.task.exact < self.free_joints

    @abstractmethod
    def _problem(self, m: Model, choice: bool) -> tuple[str, dict[str, Any], dict[str, Any]]:
        """Return the name of CasADi's solver, the programme of one stage and the options; `choice` is the second stage."""

    @abstractmethod
    def _status(self, answer: IkAnswer, constrained: bool) -> IKStatus:
        """Return the status for the solver's return code; `solve` verifies the pose."""

    def _build(self) -> None:
        """Build the programmes, so that the first solve is as fast as the next ones."""
        for choice in (False, True)[: 1 + self.has_second_stage]:
            self._programme(choice, self.time_limit is not None)
        self._pose = self._programme(False, self.time_limit is not None)

    def _new_programme(self, choice: bool, watched: bool) -> IkProblem:
        plugin, problem, options = self._problem(build_model(self.robot), choice)
        watch = Watch({k: problem[k].numel() for k in problem}) if watched else None
        if watch is not None:
            options = options | {"iteration_callback": watch}
        box = np.array(self.task.box)[task_rows(self.task)] if "g" in problem else np.zeros(0)
        return IkProblem(ca.nlpsol("ik", plugin, problem, options), self.robot.limits, self.bounds, box, watch)

    def _second_problem(self, m: Model) -> dict[str, Any]:
        """Build the second programme: minimise the preference with the task's components inside their box."""
        posture = ca.SX.sym("posture", self.robot.n)
        f = preference_cost(m, self.task, self.robot, self.preference.weights, posture)
        return {
            "x": m.q,
            "p": ca.vertcat(m.target, posture),
            "f": ca.cse(f),
            "g": ca.cse(error_components(m, self.task)),
        }

    def solve(self, target: ArrayLike, q0: ArrayLike, *, trace: bool = False, closest: bool = False) -> IKResult:
        """Find a configuration whose tool pose is the target; a call without trace and preference avoids all copies."""
        if trace or not self._quick:
            return super().solve(target, q0, trace=trace, closest=closest)
        with self._lock:
            answer = self._pose.solve_arrays(target, q0)
            if answer is not None:
                goal: Any = (self.task.flags, target)
                position, rotation, inside = judge(self.robot.chain, self._limits, goal, LIMIT_TOLERANCE, answer.q)
                if position <= self._position and rotation <= self._rotation and inside:
                    message = self._prefix + answer.code + self._suffix
                    return _new(IKResult, (answer.q, _solved, answer.iterations, 0, position, rotation, None, message))
            self._first = answer
            return super().solve(target, q0, closest=closest)

    def _solve(self, target: Array, q0: Array, trace: bool) -> IKResult:
        with self._lock:  # threads share the buffers: `solve_ik` caches one solver for all of them
            self._parameters[12:] = self.preference.objective(q0)[1]
            return super()._solve(target, q0, trace)

    def attempt(self, target: Array, start: Array, trace: bool, time_limit: float | None) -> Attempt:
        """Solve for the pose and then minimise the preference; both stages respect the time limit."""
        end = np.inf if time_limit is None else time.perf_counter() + time_limit
        pose_parameters(target, self._parameters[:12])
        watched = trace or self.time_limit is not None
        programme = self._programme(False, watched)
        answer, self._first = self._first or programme.solve(start, self._parameters[:12], end), None
        status = self._status(answer, programme.constrained)
        q, count, message = answer.q, answer.iterations, self._prefix + answer.code
        visited = [start, *answer.visited]
        if self.has_second_stage and status is IKStatus.SOLVED and self._is_solution(q, target):
            better = self._programme(True, watched).solve(q, self._parameters, end)
            count, visited = count + better.iterations, [*visited, *better.visited]
            message += f", then {better.code}"
            if self._is_solution(better.q, target) and self._value(target, better.q) <= self._value(target, q):
                q = better.q
            else:  # the pose must stay met, and the preference must not get worse
                message += " (discarded)"
        else:
            message += self._suffix
        errors = self.robot.pose_errors(np.array(visited), target) if trace else None
        return Attempt(q, status, count, errors, message)

    def _value(self, target: Array, q: Array) -> float:
        """Return the cost of the preference at q."""
        return self.preference.value(self.task, target, self._parameters[12:], q)

    def _is_solution(self, q: Array, target: Array) -> bool:
        position, rotation, inside = self._measure(q, target)
        return position <= self.tolerance.position and rotation <= self.tolerance.rotation and inside


def _tighten_limits(robot: Robot, distance: float) -> JointLimits:
    """Return the position limits moved inwards by a distance, except those of locked joints."""
    lower, upper = robot.limits.lower, robot.limits.upper
    moves = lower < upper
    tight_lower, tight_upper = lower + distance * moves, upper - distance * moves
    if (tight_lower > tight_upper).any():
        i = int(np.argmax(tight_lower - tight_upper))
        room = f"at most {robot.limits.half[i]:.6g}, half the range of {robot.joint_names[i]}"
        raise InvalidInput("limit_distance", f"{distance:.6g}", room)
    return JointLimits(tight_lower, tight_upper)
