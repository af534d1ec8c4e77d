"""What every IK method shares: its options, the checks, the restarts, and the check of what it claims."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.reach import outside_reach, reach_bound
from optik.arm.robot import Robot
from optik.check import check_count, check_flag, check_number
from optik.errors import InvalidInput, Unsupported
from optik.ik._closest import nearest
from optik.ik._problem import check_batch, check_problem, restart_configuration
from optik.ik._result import SOLVED_WITHIN
from optik.ik._result import IKBatch as IKBatch
from optik.ik._result import IKResult as IKResult
from optik.ik._result import Tolerance as Tolerance
from optik.ik._status import STATUS_OF_CODE
from optik.ik._status import IKStatus as IKStatus
from optik.task import Task, as_task, judge
from optik.types import Array

MOST_TRIES = 1_000_000_000
"""Largest number of iterations of an attempt, and of restarts: more would take days, and overflow the int32 of a batch."""

MOST_TRACED = 1_000_000
"""Largest number of iterations whose errors are kept: an error takes 48 bytes, so these take 48 MB."""


class Attempt(NamedTuple):
    """What a method reports of one attempt from one start; `IKSolver.solve` checks it by our own forward kinematics.

    Attributes
    ----------
    q : (n,) array
        Its configuration [rad, m].
    status : IKStatus
        How it ended, by the method.
    iterations : int
        As the method counts them.
    trace : (k + 1, 6) array or None
        On request, the error twists of its iterates in the base frame [m, rad].
    message : str
        More, in words.
    """

    q: Array
    status: IKStatus
    iterations: int
    trace: Array | None = None
    message: str = ""


class IKSolver(ABC):
    """A method built for one robot; building may compile, solving does not. Pickles as its robot and options.

    A method is a subclass in a file of its own that implements `attempt` and names itself ``METHOD``.

    Parameters
    ----------
    robot : Robot
        The arm.
    tolerance : Tolerance
        What counts as solved.
    max_iterations : int
        Iterations of one attempt at most.
    max_restarts : int
        Attempts after the first at most, from initial guesses drawn inside the limits: the same for the same problem.
    time_limit : float, optional
        Wall-clock time for one solve [s], checked between attempts and, where the method can, within one.
    task : Task or str
        What of the target must be met: ``"pose"`` (all of it), ``"position"``, ``"axis_z"`` (position and direction of
        the tool's z), or a `Task` with any mask.

    Raises
    ------
    InvalidInput
        An option out of range, or a task that the method cannot take.
    """

    name: ClassVar[str]

    takes_tasks: ClassVar[bool] = True
    """Whether the method can leave components of the pose free."""

    def __init__(
        self,
        robot: Robot,
        *,
        tolerance: Tolerance = SOLVED_WITHIN,
        max_iterations: int = 100,
        max_restarts: int = 0,
        time_limit: float | None = None,
        task: Task | str = "pose",
    ) -> None:
        if not isinstance(robot, Robot):
            raise InvalidInput("robot", type(robot).__name__, "a Robot (optik.load(name), Robot.from_mdh, ...)")
        check_count(max_iterations, "max_iterations", 0, MOST_TRIES)
        check_count(max_restarts, "max_restarts", 0, MOST_TRIES)
        if time_limit is not None:
            check_number(time_limit, "time_limit", "seconds above 0, or None", above=0.0)
        if not isinstance(tolerance, Tolerance):
            raise InvalidInput("tolerance", repr(tolerance)[:60], "a Tolerance(position=…, rotation=…)")
        self.robot = robot
        self.tolerance = tolerance
        self.max_iterations = max_iterations
        self.max_restarts = max_restarts
        self.time_limit = time_limit
        self.task = as_task(task)
        if not (self.takes_tasks or self.task.is_pose):
            raise Unsupported("task", str(task), f'"pose", the only one {self.name} can; others: dls, lm, ipopt, sqp')
        self._reach = reach_bound(robot, self.task)

    @property
    def options(self) -> dict[str, Any]:
        """All options, as they would be given again; a method adds its own."""
        return {
            "tolerance": self.tolerance,
            "max_iterations": self.max_iterations,
            "max_restarts": self.max_restarts,
            "time_limit": self.time_limit,
            "task": self.task,
        }

    def with_options(self, **changes: Any) -> Self:
        """Return the same method for the same robot with some options changed.

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
            An option that the method does not have, or out of range.
        """
        return type(self)(self.robot, **{**self.options, **changes})

    def __reduce__(self) -> tuple[Any, ...]:
        return _built, (type(self), self.robot, self.options)

    @abstractmethod
    def attempt(self, target: Array, start: Array, trace: bool, seconds: float | None) -> Attempt:
        """Try once from one start.

        Parameters
        ----------
        target : (4, 4) array
            Target pose in the base frame [1, m], checked.
        start : (n,) array
            Initial guess inside the limits [rad, m], checked.
        trace : bool
            Whether to keep the error of every iteration.
        seconds : float or None
            Time left, where the method can stop within an attempt [s].

        Returns
        -------
        Attempt
            What the method reports; `solve` judges it.
        """

    def solve(self, target: ArrayLike, q0: ArrayLike, *, trace: bool = False, closest: bool = False) -> IKResult:
        """Find a configuration whose tool pose is the target.

        Parameters
        ----------
        target : (4, 4) array
            T_base_tool [1, m].
        q0 : (n,) array
            Start, inside the limits [rad, m].
        trace : bool
            Whether to keep the error of every iteration.
        closest : bool
            Where there is no solution, whether to go on to the configuration inside the limits whose pose is nearest to
            the target: the least sum of squared errors found, 1 m counted as 1 rad. The result is still a failure.

        Returns
        -------
        IKResult
            Success is rechecked by our own forward kinematics and the limits.

        Raises
        ------
        InvalidInput
            The target is not a pose, numbers are NaN, a shape is wrong, or the start is outside the limits; a trace of
            too many iterations.
        """
        trace, closest = check_flag(trace, "trace"), check_flag(closest, "closest")
        if trace and self.max_iterations > MOST_TRACED:
            raise InvalidInput("trace", f"one of {self.max_iterations} iterations", f"at most {MOST_TRACED:,} to keep")
        target, q0 = check_problem(self.robot, target, q0)
        result = self._solve(target, q0, trace)
        return self._closest(result, target, q0) if closest and not result else result

    def solve_batch(self, targets: ArrayLike, starts: ArrayLike, *, threads: int | None = None) -> IKBatch:
        """Solve many targets, one after the other unless the method can do better.

        Parameters
        ----------
        targets : (N, 4, 4) array
            T_base_tool [1, m].
        starts : (N, n) or (n,) array
            Starts, inside the limits [rad, m].
        threads : int, optional
            Most threads; by default one for each core. The answers are the same for any number.

        Returns
        -------
        IKBatch
            The same answers as of single calls.

        Raises
        ------
        InvalidInput
            As `solve`, with the index of the first wrong problem.
        """
        poses, first = check_batch(self.robot, targets, starts)
        if threads is not None:
            check_count(threads, "threads", 1)
        batch = IKBatch.empty(len(poses), self.robot.n)
        self._fill(batch, poses, first, threads)
        return batch

    def _fill(self, batch: IKBatch, targets: Array, starts: Array, threads: int | None) -> None:
        for i, (target, start) in enumerate(zip(targets, starts, strict=True)):
            result = self._solve(target, start, False)
            q, status, *numbers = result[:6]
            batch.q[i], batch.status[i] = q, STATUS_OF_CODE.index(status)
            batch.iterations[i], batch.restarts[i], batch.position_error[i], batch.rotation_error[i] = numbers

    def _solve(self, target: Array, q0: Array, trace: bool) -> IKResult:
        """Attempts from the start and then from others, each judged, until one succeeds or none is left."""
        end = None if self.time_limit is None else time.perf_counter() + self.time_limit
        out = outside_reach(self._reach, target, self.tolerance.position, self.tolerance.rotation)
        best, outcome, iterations = None, None, 0
        for restart in range(1 if out >= 0.0 else self.max_restarts + 1):
            left = None if end is None else end - time.perf_counter()
            if restart and left is not None and left <= 0.0 and best is not None:
                return best._replace(status=IKStatus.TIME_LIMIT)
            outcome = self._attempt(restart, target, q0, trace, left, outcome)
            iterations += outcome.iterations
            result = self._judge(outcome, target)
            if result and restart == 0:
                return result
            if best is None or result or _merit(result, self.tolerance) < _merit(best, self.tolerance):
                best = result
            best = best._replace(iterations=iterations, restarts=restart)
            if best:
                break
        assert best is not None  # the loop runs at least once
        return self._proved(best, target) if out >= 0.0 and not best else best

    def _attempt(
        self, restart: int, target: Array, q0: Array, trace: bool, seconds: float | None, last: Attempt | None
    ) -> Attempt:  # fmt: skip
        """Attempt from the given start, then from others; `last` is the previous attempt."""
        start = q0 if restart == 0 else restart_configuration(self.robot, target, q0, restart)
        return self.attempt(target, start, trace, seconds)

    def _proved(self, result: IKResult, target: Array) -> IKResult:
        """Return the result as unreachable, with the bound that proves it."""
        distance = outside_reach(self._reach, target, self.tolerance.position, self.tolerance.rotation)
        A, least, most = self._reach[:3] + 0.0, self._reach[6], self._reach[7]
        side = f"at most {most:.6g}" if distance > most else f"at least {least:.6g}"
        message = (
            f"the target asks for {distance:.6g} m between the base's point ({A[0]:.4g}, {A[1]:.4g}, {A[2]:.4g}) and the "
            f"last joint's axis or the tool; the links between them allow {side} m"
        )
        return result._replace(status=IKStatus.UNREACHABLE, message=message)

    def _closest(self, result: IKResult, target: Array, q0: Array) -> IKResult:
        """Replace the configuration of a failure by that of the nearest pose found, from it, the start and restarts."""
        starts = [result.q, q0, *(restart_configuration(self.robot, target, q0, r) for r in range(1, 9))]
        q = nearest(self.robot, self.task, target, np.array(starts))
        position, rotation, _ = self._measure(q, target)
        if position <= self.tolerance.position and rotation <= self.tolerance.rotation:
            return IKResult(q, IKStatus.SOLVED, result.iterations, result.restarts, position, rotation, result.trace)
        return result._replace(q=q, position_error=position, rotation_error=rotation)

    def _judge(self, outcome: Attempt, target: Array) -> IKResult:
        """Measure the outcome with our own forward kinematics and limits, and set the status accordingly."""
        q, status = outcome.q, outcome.status
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

    def _measure(self, q: Array, target: Array) -> tuple[float, float, bool]:
        robot = self.robot
        limits = robot.limits.lower, robot.limits.upper
        return judge(robot.chain, limits, (self.task.flags, target), LIMIT_TOLERANCE, q)


def _merit(result: IKResult, tolerance: Tolerance) -> float:
    return max(result.position_error / tolerance.position, result.rotation_error / tolerance.rotation)


def _built(kind: type[IKSolver], robot: Robot, options: dict[str, Any]) -> IKSolver:
    return kind(robot, **options)


METHOD_BASE = IKSolver
"""What the METHOD of every module here, and of every plug-in, is a subclass of."""
