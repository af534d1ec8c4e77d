"""What the CasADi methods share: bounds at a distance from the limits, the two stages, and a solver called by buffers."""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Mapping
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LIMIT_TOLERANCE, JointLimits
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.ik._casadi.solver import Answer, Programme, Watch
from optik.ik._casadi.symbolic import Model, components, model, pose_parameters, preference_cost, task_rows
from optik.ik._preference import Preference
from optik.ik.base import Attempt, IKResult, IKSolver, IKStatus
from optik.task import judge
from optik.types import Array

# Looking these up where they belong costs a microsecond a call.
_solved, _new = IKStatus.SOLVED, tuple.__new__


class ProgrammeSolver(IKSolver):
    """IK as a nonlinear programme: first the pose, then the preference along the motion that the task leaves free.

    Parameters
    ----------
    robot : Robot
        The arm.
    prefer : str or mapping of name to weight, optional
        ``"posture"``, ``"limits"``, ``"manipulability"`` or weights of these, as `LM` takes them: a weighted sum that is
        minimised along the motion that the task leaves free, from the configuration that met the pose, to a local
        minimum. Where nothing is free (six joints and a full pose) it changes nothing, and ``message`` says so.
    posture : (n,) array, optional
        Posture of ``"posture"`` [rad, m]; by default the start.
    limit_distance : float
        Distance that every joint keeps from its position limits [rad, m]; locked joints stay where they are. A start
        that is nearer is moved inside.
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
        self.preference = Preference.of(robot, prefer, posture)
        self.limit_distance = check_number(limit_distance, "limit_distance", "a distance ≥ 0 [rad, m]", least=0.0)
        self.bounds = _inside(robot, self.limit_distance)
        self.free_joints = int((self.bounds.lower < self.bounds.upper).sum())
        self._parameters = np.zeros(12 + robot.n)
        self._quick = self.time_limit is None and not self.chooses
        self._limits = robot.limits.lower, robot.limits.upper
        self._position, self._rotation = self.tolerance.position, self.tolerance.rotation
        self._prefix = f"{self.name.upper()}: "
        note = self.preference.note(self.task, self.free_joints)
        self._suffix = f"; {note}" if note else ""
        self._first: Answer | None = None
        self._lock = threading.RLock()
        self._programme = cache(self._new_programme)

    @property
    def options(self) -> dict[str, Any]:
        """All options, as they would be given again."""
        return {**super().options, **self.preference.options, "limit_distance": self.limit_distance}

    @property
    def chooses(self) -> bool:
        """Whether something is preferred and the task leaves it a motion."""
        return bool(self.preference) and self.task.exact < self.free_joints

    @abstractmethod
    def _problem(self, m: Model, choice: bool) -> tuple[str, dict[str, Any], dict[str, Any]]:
        """Name of CasADi's solver, the programme of one stage (the pose, or the choice) and the solver's options."""

    @abstractmethod
    def _status(self, answer: Answer, constrained: bool) -> IKStatus:
        """Status for the solver's return code; whether the pose is met is checked elsewhere."""

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
        f = preference_cost(m, self.task, self.robot, self.preference.weights, posture)
        return {"x": m.q, "p": ca.vertcat(m.target, posture), "f": ca.cse(f), "g": ca.cse(components(m, self.task))}

    def solve(self, target: ArrayLike, q0: ArrayLike, *, trace: bool = False, closest: bool = False) -> IKResult:
        """Find a configuration whose tool pose is the target; the usual call goes straight through the buffers."""
        if trace or not self._quick:
            return super().solve(target, q0, trace=trace, closest=closest)
        with self._lock:
            answer = self._pose.answer(target, q0)
            if answer is not None:
                goal: Any = (self.task.flags, target)
                position, rotation, inside = judge(self.robot.chain, self._limits, goal, LIMIT_TOLERANCE, answer.q)
                if position <= self._position and rotation <= self._rotation and inside:
                    message = self._prefix + answer.code + self._suffix
                    return _new(IKResult, (answer.q, _solved, answer.iterations, 0, position, rotation, None, message))
            self._first = answer
            return super().solve(target, q0, closest=closest)

    def _solve(self, target: Array, q0: Array, trace: bool) -> IKResult:
        with self._lock:  # the buffers are shared; `solve_ik` keeps one solver for all threads
            self._parameters[12:] = self.preference.wish(q0)[1]
            return super()._solve(target, q0, trace)

    def attempt(self, target: Array, start: Array, trace: bool, seconds: float | None) -> Attempt:
        """Meet the pose from the start, and then minimise what is preferred; the time limit is kept inside too."""
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
            if self._meets(better.q, target) and self._value(target, better.q) <= self._value(target, q):
                q = better.q
            else:  # the pose is what counts, and the preference must not become worse
                message += " (not kept)"
        else:
            message += self._suffix
        errors = self.robot.pose_errors(np.array(visited), target) if trace else None
        return Attempt(q, status, count, errors, message)

    def _value(self, target: Array, q: Array) -> float:
        """What is preferred at q, for the problem at hand: what every method minimises."""
        return self.preference.value(self.task, target, self._parameters[12:], q)

    def _meets(self, q: Array, target: Array) -> bool:
        position, rotation, inside = self._measure(q, target)
        return position <= self.tolerance.position and rotation <= self.tolerance.rotation and inside


def _inside(robot: Robot, distance: float) -> JointLimits:
    """Position limits moved inward by a distance, but for locked joints; raises InvalidInput where no room is left."""
    lower, upper = robot.limits.lower, robot.limits.upper
    moves = lower < upper
    tight_lower, tight_upper = lower + distance * moves, upper - distance * moves
    if (tight_lower > tight_upper).any():
        i = int(np.argmax(tight_lower - tight_upper))
        room = f"at most {robot.limits.half[i]:.6g}, half the range of {robot.joint_names[i]}"
        raise InvalidInput("limit_distance", f"{distance:.6g}", room)
    return JointLimits(tight_lower, tight_upper)
