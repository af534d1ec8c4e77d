"""What every IK method shares: the result, its status, the tolerance, the checks, the restarts and the judgement."""

from __future__ import annotations

import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.kinematics import judge
from optik.robot import LIMIT_TOLERANCE, Robot
from optik.se3 import check_pose

Array = NDArray[np.float64]


class IKStatus(StrEnum):
    """How a solve ended."""

    SOLVED = "solved"
    MAX_ITERATIONS = "max_iterations"
    STALLED = "stalled"
    TIME_LIMIT = "time_limit"
    OUTSIDE_LIMITS = "outside_limits"
    UNREACHABLE = "unreachable"
    REJECTED = "rejected"

    @property
    def advice(self) -> str:
        """What to try."""
        return _ADVICE[self]


_ADVICE: Mapping[IKStatus, str] = {
    IKStatus.SOLVED: "",
    IKStatus.MAX_ITERATIONS: "more iterations, restarts (max_restarts), or a start nearer to the target",
    IKStatus.STALLED: "restarts (max_restarts) or another start: this one leads to a local minimum or a joint limit",
    IKStatus.TIME_LIMIT: "a longer time limit, or a start nearer to the target",
    IKStatus.OUTSIDE_LIMITS: "restarts (max_restarts): the pose was met, but only with a joint outside its limits",
    IKStatus.UNREACHABLE: "a target nearer to the base, or a longer tool",
    IKStatus.REJECTED: "another method: this one claimed a success that forward kinematics does not confirm",
}


@dataclass(frozen=True)
class Tolerance:
    """What counts as solved: BOTH error norms within it, by our own forward kinematics.

    Parameters
    ----------
    position : float
        Largest distance [m].
    rotation : float
        Largest angle [rad].
    """

    position: float = 1e-6
    rotation: float = 1e-6

    def __post_init__(self) -> None:
        for field in ("position", "rotation"):
            check_number(getattr(self, field), f"tolerance.{field}", "a number above 0", above=0.0)


class IKResult(NamedTuple):
    """The answer of one solve. ``bool(result)`` is success.

    Attributes
    ----------
    q : (n,) array
        The configuration; on failure the best found, inside the limits.
    status : IKStatus
        How it ended; ``status.advice`` says what to try.
    iterations : int
        Of the method, over all attempts.
    restarts : int
        Attempts after the first.
    position_error, rotation_error : float
        At q, by our own forward kinematics [m, rad].
    trace : (k + 1, 6) array or None
        On request, the error twist (p_t − p, log(R_t Rᵀ)) before the first and after each of the k iterations of the
        attempt that found q, base frame.
    message : str
        The method's own word on how it ended.
    """

    q: Array
    status: IKStatus
    iterations: int
    restarts: int
    position_error: float
    rotation_error: float
    trace: Array | None = None
    message: str = ""

    def __bool__(self) -> bool:
        return self.status is IKStatus.SOLVED


class Attempt(NamedTuple):
    """What a method says of one attempt from one start. It is judged, never believed."""

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
        Of one attempt.
    max_restarts : int
        Attempts after the first, from starts drawn inside the limits, keyed by the problem.
    time_limit : float, optional
        Wall-clock seconds for one solve, looked at between attempts and, where the method can, within one.

    Raises
    ------
    InvalidInput
        An option out of range.
    """

    name: ClassVar[str]

    def __init__(
        self,
        robot: Robot,
        *,
        tolerance: Tolerance = Tolerance(),
        max_iterations: int = 100,
        max_restarts: int = 0,
        time_limit: float | None = None,
    ) -> None:
        if not isinstance(robot, Robot):
            raise InvalidInput("robot", type(robot).__name__, "a Robot (optik.load(name), Robot.from_mdh, ...)")
        check_count(max_iterations, "max_iterations", 0)
        check_count(max_restarts, "max_restarts", 0)
        if time_limit is not None:
            check_number(time_limit, "time_limit", "seconds above 0, or None", above=0.0)
        if not isinstance(tolerance, Tolerance):
            raise InvalidInput("tolerance", repr(tolerance)[:60], "a Tolerance(position=…, rotation=…)")
        self.robot = robot
        self.tolerance = tolerance
        self.max_iterations = max_iterations
        self.max_restarts = max_restarts
        self.time_limit = time_limit

    @property
    def options(self) -> dict[str, Any]:
        """All options, as they would be given again; a method adds its own."""
        return {
            "tolerance": self.tolerance,
            "max_iterations": self.max_iterations,
            "max_restarts": self.max_restarts,
            "time_limit": self.time_limit,
        }

    def with_options(self, **changes: Any) -> Self:
        """Return the same method for the same robot with some options changed."""
        return type(self)(self.robot, **{**self.options, **changes})

    def __reduce__(self) -> tuple[Any, ...]:
        return _built, (type(self), self.robot, self.options)

    @abstractmethod
    def attempt(self, target: Array, start: Array, trace: bool, seconds: float | None) -> Attempt:
        """Try once from one start; target (4, 4) and start (n,) are checked; at most so many seconds, where it can."""

    def solve(self, target: ArrayLike, q0: ArrayLike, *, trace: bool = False) -> IKResult:
        """Find a configuration whose tool pose is the target.

        Parameters
        ----------
        target : (4, 4) array
            T_base_tool [m].
        q0 : (n,) array
            Start, inside the limits.
        trace : bool
            Whether to keep the error of every iteration.

        Returns
        -------
        IKResult
            Success is rechecked by our own forward kinematics and the limits.

        Raises
        ------
        InvalidInput
            A target that is no pose, NaN, wrong shapes, a start outside the limits.
        """
        target = check_pose(target, "target")
        q0 = check_start(self.robot, q0)
        end = None if self.time_limit is None else time.perf_counter() + self.time_limit
        best, iterations = None, 0
        for restart in range(self.max_restarts + 1):
            left = None if end is None else end - time.perf_counter()
            if restart and left is not None and left <= 0.0 and best is not None:
                return best._replace(status=IKStatus.TIME_LIMIT)
            start = q0 if restart == 0 else restart_configuration(self.robot, target, q0, restart)
            outcome = self.attempt(target, start, trace, left)
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
        return best

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
        lower, upper = robot.limits.lower, robot.limits.upper
        return judge(robot.fixed, robot.prismatic, robot.tool, lower, upper, LIMIT_TOLERANCE, q, target)


def check_start(robot: Robot, q0: ArrayLike, argument: str = "q0") -> Array:
    """Return a start configuration, or say which joint stands outside its limits.

    Raises
    ------
    InvalidInput
        Wrong length, NaN, or outside the limits.
    """
    q = robot.configuration(q0, argument)
    if not robot.limits.contains(q):
        lower, upper = robot.limits.lower, robot.limits.upper
        i = int(np.argmax(np.maximum(lower - q, q - upper)))
        raise InvalidInput(
            argument,
            f"{robot.joint_names[i]} = {q[i]:.6g}",
            f"every joint inside its limits, here [{lower[i]:.6g}, {upper[i]:.6g}] (rad or m)",
        )
    return q


def restart_configuration(robot: Robot, target: Array, q0: Array, restart: int) -> Array:
    """Draw the start of one restart, uniform inside the limits, keyed by the problem: the same in every run."""
    problem = np.round(np.concatenate([target.ravel(), q0]), 12) + 0.0  # −0 becomes 0: the same number, the same key
    rng = np.random.default_rng((zlib.crc32(problem.tobytes()), restart))
    lower, upper = robot.limits.lower, robot.limits.upper
    # a joint without an end is drawn over one turn from the end it has, or around zero
    low = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2.0 * np.pi, -np.pi))
    return rng.uniform(low, np.where(np.isfinite(upper), upper, low + 2.0 * np.pi))


def _merit(result: IKResult, tolerance: Tolerance) -> float:
    return max(result.position_error / tolerance.position, result.rotation_error / tolerance.rotation)


def _built(kind: type[IKSolver], robot: Robot, options: dict[str, Any]) -> IKSolver:
    return kind(robot, **options)
