"""What the CasADi methods share: bounds kept at a distance, what to prefer, and a solver called through its buffers."""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Mapping
from functools import cache, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LIMIT_TOLERANCE, JointLimits
from optik.arm.robot import Robot
from optik.check import check_number
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.ik._casadi.symbolic import Model, components, model, pose_parameters, preference, task_rows
from optik.ik._preference import nothing_free, read_posture, read_weights
from optik.ik.base import Attempt, IKResult, IKSolver, IKStatus
from optik.se3 import is_pose
from optik.task import judge
from optik.types import Array

_STOPPED = "User_Requested_Stop"

# Looking these up where they belong costs a microsecond a call.
_SOLVED, _new = IKStatus.SOLVED, tuple.__new__

_FLOAT = np.dtype(np.float64)
"""Comparing with the type itself takes as long as three calls."""


class ProgrammeSolver(IKSolver):
    """IK as a nonlinear programme: first the pose, then, among the configurations that keep it, what is preferred.

    Parameters
    ----------
    robot : Robot
        The arm.
    prefer : str or mapping of name to weight, optional
        Out of `optik.ik._preference.PREFERENCES`: "posture", "limits", "manipulability". A weighted sum, minimised along the
        motion that the task leaves free, from the configuration that met the pose: a minimum near it, not the best of
        all. Where nothing is free (six joints and a full pose) it changes nothing, and ``message`` says so.
    posture : (n,) array, optional
        For "posture"; by default the start q0.
    limit_distance : float
        How far inside its position limits every joint stays [rad, m]; locked joints stay where they are. A start nearer
        than that is moved inside.
    **options
        Those of `IKSolver`.

    Raises
    ------
    InvalidInput
        An option out of range, an unknown preference, a distance that leaves a joint no room.
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
        self.prefer = read_weights(prefer)
        self.posture = read_posture(robot, self.prefer, posture)
        self.limit_distance = check_number(limit_distance, "limit_distance", "a distance ≥ 0 [rad, m]", least=0.0)
        self.bounds = _inside(robot, self.limit_distance)
        self.free_joints = int((self.bounds.lower < self.bounds.upper).sum())
        self._parameters = np.zeros(12 + robot.n)
        self._quick = self.time_limit is None and not self.chooses
        lower, upper, flags = robot.limits.lower, robot.limits.upper, self.task.flags
        self._judge_of = partial(judge, robot.chain, lower, upper, flags, LIMIT_TOLERANCE)
        self._position, self._rotation = self.tolerance.position, self.tolerance.rotation
        self._prefix = f"{self.name.upper()}: "
        free = not self.prefer or self.chooses
        self._suffix = "" if free else f"; {nothing_free(self.task, self.free_joints)}"
        self._first: Answer | None = None
        self._lock = threading.RLock()
        self._objective: ca.Function | None = None
        self._programme = cache(self._new_programme)

    @property
    def options(self) -> dict[str, Any]:
        """All options, as they would be given again."""
        posture = None if self.posture is None else tuple(self.posture.tolist())
        ours = {"prefer": dict(self.prefer) or None, "posture": posture, "limit_distance": self.limit_distance}
        return super().options | ours

    @property
    def chooses(self) -> bool:
        """Whether something is preferred and the task leaves it a motion."""
        return bool(self.prefer) and self.task.exact < self.free_joints

    @abstractmethod
    def _problem(self, m: Model, choice: bool) -> tuple[str, dict[str, Any], dict[str, Any]]:
        """Name of CasADi's solver, the programme of one stage (the pose, or the choice) and the solver's options."""

    @abstractmethod
    def _status(self, answer: Answer, constrained: bool) -> IKStatus:
        """Translate the solver's own word on the pose; met it is judged by others."""

    def _build(self) -> None:
        """Build now, so that the first solve is not slower than the rest."""
        for choice in (False, True)[: 1 + self.chooses]:
            self._programme(choice, self.time_limit is not None)
        self._pose = self._programme(False, self.time_limit is not None)

    def _new_programme(self, choice: bool, watched: bool) -> Programme:
        plugin, problem, options = self._problem(model(self.robot), choice)
        watch = Watch({k: problem[k].numel() for k in problem}) if watched else None
        if watch is not None:
            options = options | {"iteration_callback": watch}
        box = np.array(self.task.box)[task_rows(self.task)] if "g" in problem else np.zeros(0)
        return Programme(ca.nlpsol("ik", plugin, problem, options), self.robot.limits, self.bounds, box, watch)

    def _chosen(self, m: Model) -> dict[str, Any]:
        """The programme of the second stage: the preference, with the task's components inside their box."""
        posture = ca.SX.sym("posture", self.robot.n)
        f = preference(m, self.task, self.robot, self.prefer, posture)
        return {"x": m.q, "p": ca.vertcat(m.target, posture), "f": ca.cse(f), "g": ca.cse(components(m, self.task))}

    def solve(self, target: ArrayLike, q0: ArrayLike, *, trace: bool = False, closest: bool = False) -> IKResult:
        """Find a configuration whose tool pose is the target; see `IKSolver.solve`.

        The usual call, whose first attempt meets the pose, goes straight through the buffers.
        """
        if trace or not self._quick:
            return super().solve(target, q0, trace=trace, closest=closest)
        with self._lock:
            answer = self._pose.answer(target, q0)
            if answer is not None:
                position, rotation, inside = self._judge_of(answer.q, target)  # type: ignore[arg-type]
                if position <= self._position and rotation <= self._rotation and inside:
                    message = self._prefix + answer.code + self._suffix
                    return _new(IKResult, (answer.q, _SOLVED, answer.iterations, 0, position, rotation, None, message))
            self._first = answer
            return super().solve(target, q0, closest=closest)

    def _solve(self, target: Array, q0: Array, trace: bool) -> IKResult:
        with self._lock:  # the buffers are shared; `solve_ik` keeps one solver for all threads
            self._parameters[12:] = q0 if self.posture is None else self.posture
            return super()._solve(target, q0, trace)

    def attempt(self, target: Array, start: Array, trace: bool, seconds: float | None) -> Attempt:
        """Meet the pose from the start, and then improve on what is preferred; the time limit is kept inside too."""
        end = np.inf if seconds is None else time.perf_counter() + seconds
        pose_parameters(target, self._parameters[:12])
        watched = trace or self.time_limit is not None
        programme = self._programme(False, watched)
        answer, self._first = self._first or programme.solve(start, self._parameters[:12], end), None
        status = self._status(answer, programme.constrained)
        q, count, message = answer.q, answer.iterations, self._prefix + answer.code
        visited = [start, *answer.visited]
        if self.chooses and status is IKStatus.SOLVED and self._meets(q, target):
            better = self._programme(True, watched).solve(q, self._parameters, end)
            count, visited = count + better.iterations, [*visited, *better.visited]
            message += f", then {better.code}"
            if self._meets(better.q, target) and self._worth(better.q) <= self._worth(q):
                q = better.q
            else:  # the pose is what counts, and nothing is made worse
                message += " (not kept)"
        else:
            message += self._suffix
        errors = self.robot.errors(np.array(visited), target) if trace else None
        return Attempt(q, status, count, errors, message)

    def _worth(self, q: Array) -> float:
        """What is minimised for the preference, at q for the problem at hand."""
        if self._objective is None:
            problem = self._chosen(model(self.robot))
            self._objective = ca.Function("worth", [problem["x"], problem["p"]], [problem["f"]])
        return float(self._objective(q, self._parameters))

    def _meets(self, q: Array, target: Array) -> bool:
        position, rotation, inside = self._measure(q, target)
        return position <= self.tolerance.position and rotation <= self.tolerance.rotation and inside


class Answer(NamedTuple):
    """What a solver leaves in its buffers.

    Attributes
    ----------
    q : (n,) array
        Its last iterate, inside the bounds: IPOPT relaxes them by 1e-8, ours are hard.
    f : float
        Its objective there.
    code : str
        Its own word on how it ended.
    iterations : int
        As it counts them.
    visited : list of (n,) arrays
        Iterates 1 to `iterations`, where they were watched.
    """

    q: Array
    f: float
    code: str
    iterations: int
    visited: list[Array]


class Programme:
    """A CasADi solver called through its buffers: arrays set once, no dictionary and no conversion in a call.

    Parameters
    ----------
    function : casadi.Function
        What ``nlpsol`` built. (Code generated from it in C, or fatrop, would be called in the same way: measured, the
        former is five times faster for ``sqp``, but needs a compiler on the user's machine.)
    limits : JointLimits
        That starts must keep.
    bounds : JointLimits
        Of x.
    box : (rows,) array
        Of g, both ways; none where there is no g.
    watch : Watch, optional
        The callback that it was built with.
    """

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

    def answer(self, target: Any, q0: Any) -> Answer | None:
        """Run for a target pose from a start, both as the caller gave them; None where they want a closer look."""
        if not (type(target) is type(q0) is np.ndarray and target.dtype == q0.dtype == _FLOAT):
            return None
        if not (target.shape == (4, 4) and q0.shape == self._x0.shape and target.flags.carray and q0.flags.carray):
            return None
        return self._run(np.inf) if take(target, q0, self._limits, self._x0, self._p) else None

    def solve(self, start: Array, parameters: Array, end: float) -> Answer:
        """Run from a start, moved inside the bounds; watched, it stops at the time ``end`` of the performance counter."""
        clamp(start, self._in["lbx"], self._in["ubx"], self._in["x0"])
        self._in["p"][:] = parameters
        return self._run(end)

    def _run(self, end: float) -> Answer:
        if self._watch is not None:
            self._watch.begin(end)
        try:
            self._call()
            stats = self._buffer.stats()
            code, count = stats["return_status"], stats["iter_count"]
        except (RuntimeError, KeyError) as error:  # nothing of CasADi's escapes
            return Answer(self._in["x0"].copy(), np.inf, first_line(error), 0, [])
        q = np.empty(self._in["x0"].size)
        clamp(self._out["x"], self._in["lbx"], self._in["ubx"], q)
        visited: list[Array] = []
        if (
            self._watch is not None
        ):  # iterate 0 is the start; the last may come twice, or (after a restoration) not at all
            before = self._watch.seen[1:count]
            visited = [*before, *[q] * (count - len(before))]
        return Answer(q, self._out["f"].item(), code, count, visited)


@compiled
def clamp(q: Array, lower: Array, upper: Array, out: Array) -> None:
    """Copy q (n,) into out, moved inside its bounds; NaN stays."""
    for i in range(q.shape[0]):
        x = q[i]
        out[i] = upper[i] if x > upper[i] else (lower[i] if x < lower[i] else x)


@compiled
def take(target: Array, q0: Array, limits: Array, x0: Array, parameters: Array) -> bool:
    """Check a target (4, 4) and a start (n,), and write them into a programme's x0, moved inside its bounds, and p.

    limits (4, n) are the joints' lower and upper limits, and the programme's lower and upper bounds.
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
    """Keeps every iterate that a solver reports, and stops it when its time is over.

    Parameters
    ----------
    sizes : mapping
        Lengths of x and p, and of g where there is one.
    """

    def __init__(self, sizes: Mapping[str, int]) -> None:
        super().__init__()
        x, g, p = sizes["x"], sizes.get("g", 0), sizes["p"]
        self._sizes = {"x": x, "f": 1, "g": g, "lam_x": x, "lam_g": g, "lam_p": p}
        self.seen: list[Array] = []
        self._end = np.inf
        self.construct("watch", {})

    def begin(self, end: float) -> None:
        """Forget what was seen, and stop at a time of the performance counter."""
        self.seen.clear()
        self._end = end

    def get_n_in(self) -> int:
        """As many as a solver has results."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """One: whether to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Name of a solver's result."""
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Shape of a solver's result."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arguments: Any) -> list[int]:
        """Take note of an iterate."""
        self.seen.append(np.asarray(arguments[0], dtype=np.float64).ravel())
        return [int(time.perf_counter() >= self._end)]


def first_line(error: Exception) -> str:
    """What CasADi means by an exception, without the address of its source."""
    return str(error).strip().splitlines()[-1][:120]


def _inside(robot: Robot, distance: float) -> JointLimits:
    """Position limits drawn in by a distance; those of locked joints as they are."""
    lower, upper = robot.limits.lower, robot.limits.upper
    moves = lower < upper
    tight_lower, tight_upper = lower + distance * moves, upper - distance * moves
    if (tight_lower > tight_upper).any():
        i = int(np.argmax(tight_lower - tight_upper))
        room = f"at most {robot.limits.half[i]:.6g}, half the range of {robot.joint_names[i]}"
        raise InvalidInput("limit_distance", f"{distance:.6g}", room)
    return JointLimits(tight_lower, tight_upper)
