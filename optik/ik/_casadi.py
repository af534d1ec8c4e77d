"""Base class of the CasADi methods: symbolic model, solvers called through buffers, a second programme for a preference."""

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
from optik.ik._null_space import RANK_FLOOR, Preference
from optik.ik.base import Attempt, IKResult, IKSolver, IKStatus
from optik.se3 import is_pose
from optik.task import Task, judge
from optik.types import Array

# ---------------- casADi expressions of a robot's tool pose and Jacobian


HESSIAN_DAMPING = 0.3
"""c in the Hessian JᵀJ + c·E·I, with E the sum of squares. Measurements do not distinguish values from 0.1 to 1."""
_FLOOR = 1e-10
"""Least curvature [m², rad²]: it keeps the Hessian positive definite in the null space of the task."""
_HALF_TURN = 1e-9
"""Added to (2 cos ½θ)² so that derivatives are finite at half a turn; near the target it shortens e by a fraction of 1e-10."""


class SymbolicModel(NamedTuple):
    """Expressions of a robot's tool pose p (3,), R (3, 3) and geometric Jacobian J (6, n), rows (v, ω), in the base frame.

    Their symbols are the configuration q (n,) and the target (12,): the first three rows of its pose, row by row, which
    `pose_parameters` fills.
    """

    q: Any
    target: Any
    p: Any
    R: Any
    J: Any


def build_model(robot: Robot) -> SymbolicModel:
    """Build the model of a robot as the product of its transforms, without their zeros."""
    q, target = ca.SX.sym("q", robot.n), ca.SX.sym("target", 12)
    p, R = ca.SX.zeros(3), ca.SX.eye(3)
    arm, follow = robot.axes, robot.linkage
    x = q if follow is None else ca.mtimes(ca.DM(follow.matrix), q) + ca.DM(follow.offset)
    axes = []
    for i in range(arm.n):
        p, R = _attach(p, R, arm.fixed[i])
        if arm.prismatic[i]:
            p = p + x[i] * R[:, 2]
        else:
            c, s = ca.cos(x[i]), ca.sin(x[i])
            R = ca.horzcat(c * R[:, 0] + s * R[:, 1], c * R[:, 1] - s * R[:, 0], R[:, 2])
        axes.append((p, R[:, 2]))
    p, R = _attach(p, R, robot.tool)
    columns = [
        ca.vertcat(z, ca.SX.zeros(3)) if slides else ca.vertcat(ca.cross(z, p - o), z)
        for (o, z), slides in zip(axes, arm.prismatic, strict=True)
    ]
    J = ca.horzcat(*columns) if follow is None else ca.mtimes(ca.horzcat(*columns), ca.DM(follow.matrix))
    return SymbolicModel(q, target, ca.densify(p), ca.densify(R), ca.densify(J))


def pose_parameters(target: Array, out: Array) -> None:
    """Write a target pose into the parameters of a model."""
    out[:] = target[:3].ravel()


def constrained_rows(task: Task) -> list[int]:
    """Return the indices of the components that a task constrains; for an axis, the two components across it."""
    return [i for i in range(6) if task.mask[i]]


def error_components(m: SymbolicModel, task: Task) -> Any:
    """Return the errors of the task's components along the axes of its frame, before its box is subtracted.

    A rotation error with a box is that of `optik.task.task_error`. Without a box it is the chord 2 sin ½θ instead of the
    angle θ, with the same single zero.
    """
    position, D = _relative_pose(m, task)
    exact = any(task.box[3:])
    free = [k for k in range(3) if not task.mask[3 + k]]
    turn = _axis_error(D, free[0], exact) if len(free) == 1 else _rotation_error(D, exact)
    return ca.vertcat(position, turn)[constrained_rows(task)]


def cost(m: SymbolicModel, task: Task) -> Any:
    """Return E, half the sum of squares of the task's error outside its box: ½|Δp|² + ¼|R − R_t|² for a pose.

    ¼|R − R_t|² is ½(2 sin ½θ)². Without a box on the rotation E is smooth everywhere.
    """
    rows, e = constrained_rows(task), error_components(m, task)
    smooth = _is_smooth(task)
    total = ca.SX(0.0)
    for i, row in enumerate(rows):
        if row < 3 or not smooth:
            beyond = e[i] if task.box[row] == 0.0 else ca.fmax(ca.fabs(e[i]) - task.box[row], 0.0)
            total += 0.5 * beyond**2
    if smooth and all(task.mask[3:]):
        total += 0.25 * ca.sumsqr(m.R - _target_pose(m)[1])
    elif smooth and any(task.mask[3:]):  # the distance between the tip of the tool's axis and of the target's
        k = task.mask[3:].index(False)
        total += 0.5 * ca.sumsqr(_relative_pose(m, task)[1][:, k] - ca.SX.eye(3)[:, k])
    return total


def _is_smooth(task: Task) -> bool:
    """Return whether the rotation error vanishes only at the target rotation or axis: no box, no single component."""
    return not any(task.box[3:]) and sum(task.mask[3:]) != 1


def cost_derivatives(m: SymbolicModel, task: Task) -> tuple[Any, Any, Any]:
    """Return `cost` E, its gradient, and its Gauss–Newton Hessian JᵀJ + c·E·I, with J the task's rows.

    E depends only on the tool pose. Its derivatives with respect to the pose are a force and a torque, and Jᵀ maps them
    to the gradient. J is the geometric Jacobian, which is cheaper, if it equals the error's Jacobian at zero error.
    """
    p, R = ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3)
    f = cost(m._replace(p=p, R=R), task)
    force, pull = ca.gradient(f, p), ca.gradient(f, R)
    torque = sum((ca.cross(R[:, k], pull[:, k]) for k in range(3)), ca.SX.zeros(3))
    f, force, torque = ca.substitute([f, force, torque], [p, R], [m.p, m.R])
    rows = task_jacobian(m, task) if _is_smooth(task) else ca.jacobian(error_components(m, task), m.q)
    if any(task.box):  # components inside the box contribute nothing
        outside = ca.fabs(error_components(m, task)) > np.array(task.box)[constrained_rows(task)]
        rows = ca.diag(outside) @ rows
    H = rows.T @ rows + (HESSIAN_DAMPING * f + _FLOOR) * ca.SX.eye(m.q.numel())
    return f, m.J.T @ ca.vertcat(force, torque), H


def task_jacobian(m: SymbolicModel, task: Task) -> Any:
    """Return the rows of the geometric Jacobian that a task constrains, along the axes of its frame."""
    J = m.J
    if task.frame == "target" and not all(task.mask):
        back = _target_pose(m)[1].T
        J = ca.vertcat(back @ J[:3, :], back @ J[3:, :])
    return J[constrained_rows(task), :]


def preference_cost(m: SymbolicModel, task: Task, robot: Robot, weights: Mapping[str, float], posture: Any) -> Any:
    """Return the weighted sum of the preference: the function of `optik.ik._null_space.cost`."""
    total = ca.SX(0.0)
    for name, weight in weights.items():
        if name == "posture":
            total += 0.5 * weight * ca.sumsqr(m.q - posture)
        elif name == "limits":
            middle, half = robot.limits.middle, robot.limits.half
            for i in np.flatnonzero(robot.limits.bounded):
                total += 0.5 * weight * ((m.q[int(i)] - middle[i]) / half[i]) ** 2
        else:
            rows = task_jacobian(m, task)
            total -= weight * _log_root_det(rows @ rows.T + RANK_FLOOR * ca.SX.eye(rows.size1()))
    return total


def _log_root_det(A: Any) -> Any:
    """Return log √det A of a positive definite matrix: the sum of the logarithms of its Cholesky factor's diagonal."""
    n = A.size1()
    L = ca.SX.zeros(n, n)
    total = ca.SX(0.0)
    for j in range(n):
        L[j, j] = ca.sqrt(A[j, j] - ca.sumsqr(L[j, :j]))
        for i in range(j + 1, n):
            L[i, j] = (A[i, j] - ca.dot(L[i, :j], L[j, :j])) / L[j, j]
        total += ca.log(L[j, j])
    return total


def _target_pose(m: SymbolicModel) -> tuple[Any, Any]:
    T = ca.reshape(m.target, 4, 3).T
    return T[:, 3], T[:, :3]


def _relative_pose(m: SymbolicModel, task: Task) -> tuple[Any, Any]:
    """Return the position error (3,) along the task's axes, and the rotation error as a matrix (3, 3)."""
    p, R = _target_pose(m)
    if task.frame == "target":
        return R.T @ (p - m.p), R.T @ m.R
    return p - m.p, m.R @ R.T


def _rotation_error(D: Any, exact: bool) -> Any:
    """Return the error (3,) of the rotation D: minus its axis times 2 sin ½θ, or times θ if exact."""
    root = ca.sqrt(1.0 + ca.trace(D) + _HALF_TURN)  # 2 cos ½θ
    v = ca.vertcat(D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]) / root
    if not exact:
        return v
    s = ca.sqrt(ca.sumsqr(v) + 1e-16)
    return v * (2.0 * ca.atan2(s, root) / s)


def _axis_error(D: Any, k: int, exact: bool) -> Any:
    """Return the error (3,) of axis k of the rotation D: zero along the axis, with the length 2 sin ½φ, or φ if exact."""
    i, j = (k + 1) % 3, (k + 2) % 3
    if exact:
        s = ca.sqrt(D[i, k] ** 2 + D[j, k] ** 2 + 1e-16)
        scale = ca.atan2(s, D[k, k]) / s
    else:
        scale = ca.sqrt(2.0 / (1.0 + D[k, k] + _HALF_TURN))
    e = ca.SX.zeros(3)
    e[i], e[j] = D[j, k] * scale, -D[i, k] * scale
    return e


def _attach(p: Any, R: Any, T: Array) -> tuple[Any, Any]:
    """Return position and rotation after a fixed transform, without the terms that are zero up to rounding."""
    exact = np.where(np.abs(T) < 1e-15, 0.0, np.where(np.abs(np.abs(T) - 1.0) < 1e-15, np.sign(T), T))
    return p + R @ ca.sparsify(ca.SX(exact[:3, 3])), ca.densify(R @ ca.sparsify(ca.SX(exact[:3, :3])))


# ---------------- base class of the CasADi methods


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
    def _problem(self, m: SymbolicModel, choice: bool) -> tuple[str, dict[str, Any], dict[str, Any]]:
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
        box = np.array(self.task.box)[constrained_rows(self.task)] if "g" in problem else np.zeros(0)
        return IkProblem(ca.nlpsol("ik", plugin, problem, options), self.robot.limits, self.bounds, box, watch)

    def _second_problem(self, m: SymbolicModel) -> dict[str, Any]:
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
