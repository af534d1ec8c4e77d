"""Base class of IK methods: options, argument checks, restarts, and verification of the result."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.reach import ask_unit, outside_reach, reach_bound
from optik.arm.robot import Robot
from optik.check import check_count, check_flag, check_number
from optik.errors import InvalidInput, Unsupported
from optik.ik import problem
from optik.ik._gauss_newton import find_nearest_pose
from optik.ik.branches import windings
from optik.ik.problem import Ends
from optik.ik.problem import IKBatch as IKBatch
from optik.ik.problem import IKResult as IKResult
from optik.ik.problem import IKStatus as IKStatus
from optik.ik.problem import Tolerance as Tolerance
from optik.ik.problem import ToleranceLike as ToleranceLike
from optik.plugins.files import defaults
from optik.registry import ClassName
from optik.task import Task, as_task, judge
from optik.types import Array

MAX_ATTEMPTS = 1_000_000_000
"""Largest max_iterations and max_restarts: more would take days and overflow the int32 of a batch."""
MOST_TRACED = 1_000_000
"""Largest max_iterations with a trace. Each iteration takes 48 bytes, so a trace takes at most 48 MB."""


class Attempt(NamedTuple):
    """Outcome of one attempt as reported by the method; `IKSolver.solve` verifies it by our own forward kinematics.

    Attributes
    ----------
    q : (n,) array
        Last or best configuration [rad, m].
    status : IKStatus
        Status by the method's own criteria.
    iterations : int
        Number of iterations as the method counts them.
    trace : (k + 1, 6) array or None
        On request, the error twists of the iterates in the base frame [m, rad].
    message : str
        Description in words.
    residual : float
        Norm of the error at the end [m, rad], where that is not at `q`; by default 0, for the norm at `q`.
    """

    q: Array
    status: IKStatus
    iterations: int
    trace: Array | None = None
    message: str = ""
    residual: float = 0.0


class IKSolver(ABC):
    """Base class of IK solvers, each built for one robot. Building may compile, solving does not.

    A method is a subclass in its own module that implements `attempt`; the module assigns it to ``METHOD``. A solver is
    pickled as its robot and options.

    Parameters
    ----------
    robot : Robot
        The arm.
    tolerance : Tolerance
        Largest errors of a solution.
    max_iterations : int
        Largest number of iterations of one attempt.
    max_restarts : int
        Largest number of attempts after the first. Their initial guesses are random configurations inside the limits,
        the same for the same problem. For an arm with fewer joints than the task has components, restarts stop when 30 attempts
        have ended at the least residual. For any other arm without a time limit, they stop when the first 30 attempts have
        all ended at the same residual.
    time_limit : float, optional
        Wall-clock time limit of one solve [s], checked between attempts and, if the method supports it, within them.
    task : Task or str
        Constrained components of the target: ``"pose"`` (all), ``"position"``, ``"axis_z"`` (position and direction of
        the tool's z axis), or a `Task` with any mask.

    Raises
    ------
    InvalidInput
        An option out of range, or a task that the method does not support.
    """

    name: ClassVar[str] = ClassName()  # type: ignore[assignment] # read as a str

    takes_tasks: ClassVar[bool] = True
    """Whether the method can leave components of the pose free."""

    def __init__(
        self, robot: Robot, *, tolerance: ToleranceLike = problem.IK_TOLERANCE, max_iterations: int = 100,
        max_restarts: int = 0, time_limit: float | None = None, task: Task | str = "pose",
    ) -> None:  # fmt: skip
        if not isinstance(robot, Robot):
            raise InvalidInput("robot", type(robot).__name__, "a Robot (optik.load(name), Robot.from_mdh, ...)")
        check_count(max_iterations, "max_iterations", 0, MAX_ATTEMPTS)
        check_count(max_restarts, "max_restarts", 0, MAX_ATTEMPTS)
        if time_limit is not None:
            check_number(time_limit, "time_limit", "seconds above 0, or None", above=0.0)
        self.robot = robot
        self.tolerance = Tolerance.of(tolerance)
        self.max_iterations = max_iterations
        self.max_restarts = max_restarts
        self.time_limit = time_limit
        self.task = as_task(task)
        if not (self.takes_tasks or self.task.is_pose):
            raise Unsupported("task", str(task), f'"pose", the only one {self.name} can; others: dls, lm, ipopt, sqp')
        self._reach = reach_bound(robot, self.task)
        self._missing = problem.describe_missing_joints(robot, self.task)

    @property
    def options(self) -> dict[str, Any]:
        """Options of the constructor with their values, which a method keeps as attributes of the same names."""
        return {name: getattr(self, name) for name in defaults(type(self)) if hasattr(self, name)}

    def with_options(self, **changes: Any) -> Self:
        """Return a solver of the same method and robot with some options changed.

        Parameters
        ----------
        **changes
            Options and their new values.

        Returns
        -------
        IKSolver
            A new solver.

        Raises
        ------
        InvalidInput
            An unknown or invalid option.
        """
        return type(self)(self.robot, **{**self.options, **changes})

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.robot, self.options)

    @abstractmethod
    def attempt(self, target: Array, start: Array, trace: bool, time_limit: float | None) -> Attempt:
        """Run one attempt from one initial guess.

        Parameters
        ----------
        target : (4, 4) array
            Valid target pose in the base frame [1, m].
        start : (n,) array
            Initial guess inside the limits [rad, m].
        trace : bool
            Whether to record the error of every iteration.
        time_limit : float or None
            Remaining time [s], for methods that can stop within an attempt.

        Returns
        -------
        Attempt
            The method's report; `solve` verifies it.
        """

    def solve(self, target: ArrayLike, q0: ArrayLike, *, trace: bool = False, closest: bool = False) -> IKResult:
        """Find a configuration whose tool pose is the target.

        Parameters
        ----------
        target : (4, 4) array
            T_base_tool [1, m].
        q0 : (n,) array
            Initial guess inside the limits [rad, m].
        trace : bool
            Whether to record the error of every iteration.
        closest : bool
            Whether to search for the nearest pose if there is no solution: the configuration inside the limits with the
            least sum of squared errors, 1 m counted as 1 rad. The result is still a failure.

        Returns
        -------
        IKResult
            Success is verified by our own forward kinematics and the limits.

        Raises
        ------
        InvalidInput
            The target is not a pose, a value is NaN, a shape is wrong, the initial guess is outside the limits, or a
            trace has too many iterations.
        """
        trace, closest = check_flag(trace, "trace"), check_flag(closest, "closest")
        if trace and self.max_iterations > MOST_TRACED:
            raise InvalidInput("trace", f"max_iterations={self.max_iterations}", f"at most {MOST_TRACED:,} iterations")
        target, q0 = problem.check_problem(self.robot, target, q0)
        result = self._solve(target, q0, trace)
        return self._find_closest(result, target, q0) if closest and not result else result

    def solve_batch(self, targets: ArrayLike, starts: ArrayLike, *, threads: int | None = None) -> IKBatch:
        """Solve many targets.

        Parameters
        ----------
        targets : (N, 4, 4) array
            T_base_tool [1, m].
        starts : (N, n) or (n,) array
            Initial guesses inside the limits [rad, m].
        threads : int, optional
            Largest number of threads, by default the number of cores. The results do not depend on it.

        Returns
        -------
        IKBatch
            The results of single calls.

        Raises
        ------
        InvalidInput
            As `solve`, with the index of the first invalid problem.
        """
        poses, first = problem.check_batch(self.robot, targets, starts)
        if threads is not None:
            check_count(threads, "threads", 1)
        batch = IKBatch.empty(len(poses), self.robot.n)
        self._fill(batch, poses, first, threads)
        return batch

    def _fill(self, batch: IKBatch, targets: Array, starts: Array, threads: int | None) -> None:
        for i, (target, start) in enumerate(zip(targets, starts, strict=True)):
            result = self._solve(target, start, False)
            q, status, *numbers = result[:6]
            batch.q[i], batch.status[i] = q, problem.STATUS_OF_CODE.index(status)
            batch.iterations[i], batch.restarts[i], batch.position_error[i], batch.rotation_error[i] = numbers

    def _solve(self, target: Array, q0: Array, trace: bool) -> IKResult:
        """Run attempts from `q0` and then from random initial guesses until one succeeds; return the best result."""
        end = None if self.time_limit is None else time.perf_counter() + self.time_limit
        out = outside_reach(self._reach, target, self.tolerance.position, self.tolerance.rotation)
        best, outcome, iterations, met = None, None, 0, False
        ends = Ends(few_joints=bool(self._missing), timed=end is not None)
        for restart in range(1 if out >= 0.0 else self.max_restarts + 1):
            remaining = None if end is None else end - time.perf_counter()
            if restart and remaining is not None and remaining <= 0.0 and best is not None:
                return best._replace(status=IKStatus.TIME_LIMIT)
            outcome = self._attempt(restart, target, q0, trace, remaining, outcome)
            iterations += outcome.iterations
            result = self._judge(outcome, target)
            if result and restart == 0:
                return result
            if best is None or result or _error_ratio(result, self.tolerance) < _error_ratio(best, self.tolerance):
                best = result
            best = best._replace(iterations=iterations, restarts=restart)
            residual = outcome.residual or float(np.hypot(result.position_error, result.rotation_error))
            outside = result.status is IKStatus.OUTSIDE_LIMITS
            met = met or outside
            if best or ends.add(residual, met=outside):
                break
        assert best is not None  # the loop runs at least once
        if met and not best and self.robot.motors is not None:
            said = "the target was met only outside the ranges of the motors"
            return best._replace(status=IKStatus.OUTSIDE_LIMITS, message=said)
        return self._mark_unreachable(best, target) if out >= 0.0 and not best else self._name_missing(best)

    def _attempt(
        self, restart: int, target: Array, q0: Array, trace: bool, time_limit: float | None, last: Attempt | None
    ) -> Attempt:  # fmt: skip
        """Run attempt number `restart`; `last` is the previous attempt."""
        start = q0 if restart == 0 else problem.sample_restart(self.robot, target, q0, restart)
        return self.attempt(target, start, trace, time_limit)

    def _mark_unreachable(self, result: IKResult, target: Array) -> IKResult:
        """Return the result with the status UNREACHABLE and the bound that proves it in the message."""
        distance = outside_reach(self._reach, target, self.tolerance.position, self.tolerance.rotation)
        A, least, most = self._reach[:3] + 0.0, self._reach[6], self._reach[7]
        side = f"at most {most:.6g}" if distance > most else f"at least {least:.6g}"
        message = (
            f"the target requires {distance:.6g} m between the point ({A[0]:.4g}, {A[1]:.4g}, {A[2]:.4g}) of the base and "
            f"the last joint axis or the tool; the links between them allow {side} m{ask_unit(distance, most)}"
        )
        return result._replace(status=IKStatus.UNREACHABLE, message=message)

    def _name_missing(self, result: IKResult) -> IKResult:
        """Return a failure with the status TOO_FEW_JOINTS if the arm has fewer joints than the task has components."""
        # A method that could not take a step says why itself.
        ended = result.iterations and result.status in (IKStatus.MAX_ITERATIONS, IKStatus.STALLED)
        if not self._missing or not ended:
            return result
        return result._replace(status=IKStatus.TOO_FEW_JOINTS, message=self._missing)

    def _find_closest(self, result: IKResult, target: Array, q0: Array) -> IKResult:
        """Return a failure with the configuration of the nearest pose, searched from it, from `q0` and from restarts."""
        starts = [result.q, q0, *(problem.sample_restart(self.robot, target, q0, r) for r in range(1, 9))]
        q = self.robot.limits.clip(find_nearest_pose(self.robot, self.task, target, np.array(starts)))
        position, rotation, _ = self._measure(q, target)
        if position <= self.tolerance.position and rotation <= self.tolerance.rotation:
            return IKResult(q, IKStatus.SOLVED, result.iterations, result.restarts, position, rotation, result.trace)
        return result._replace(q=q, position_error=position, rotation_error=rotation)

    def _judge(self, outcome: Attempt, target: Array) -> IKResult:
        """Return the result of an attempt, with errors and status by our own forward kinematics and the limits."""
        q, status = self._wind(outcome.q), outcome.status
        position, rotation, inside = self._measure(q, target)  # NaN fails every comparison below
        solves = position <= self.tolerance.position and rotation <= self.tolerance.rotation
        if solves and inside:
            status = IKStatus.SOLVED
        else:
            if solves:
                status = IKStatus.OUTSIDE_LIMITS
            elif status is IKStatus.SOLVED:
                status = IKStatus.REJECTED
            q = self.robot.limits.clip(np.where(np.isfinite(q), q, 0.0))
            position, rotation, _ = self._measure(q, target)
        return IKResult(q, status, outcome.iterations, 0, position, rotation, outcome.trace, outcome.message)

    def _wind(self, q: Array) -> Array:
        """Return the configuration, or a winding of it with all motors inside their ranges."""
        robot = self.robot
        if robot.motors is None or not np.isfinite(q).all() or robot.limits.contains(q):
            return q
        rows = windings(robot, q, q, robot.turning)
        inside = rows[robot.limits.contains(rows)]
        return inside[0] if len(inside) else q

    def _measure(self, q: Array, target: Array) -> tuple[float, float, bool]:
        """Return the position and rotation error at q [m, rad], and whether q is inside the limits."""
        robot = self.robot
        limits = robot.limits.lower, robot.limits.upper
        position, rotation, inside = judge(robot.chain, limits, (self.task.flags, target), LIMIT_TOLERANCE, q)
        return position, rotation, inside and (robot.motors is None or bool(robot.limits.contains(q)))


def _error_ratio(result: IKResult, tolerance: Tolerance) -> float:
    return max(result.position_error / tolerance.position, result.rotation_error / tolerance.rotation)


def _rebuild(kind: type[IKSolver], robot: Robot, options: dict[str, Any]) -> IKSolver:
    return kind(robot, **options)


METHOD_BASE = IKSolver
"""Base class of the METHOD of every module of this package and of every plug-in."""
