"""Drive, the base class that executes certified plans on a simulated or real arm; its set-points, options and records."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from math import ceil, pi
from typing import ClassVar, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_count, check_flag, check_number, real_array
from optik.errors import InvalidInput
from optik.registry import ClassName
from optik.types import Array
from planners.certificate.violation import Allow
from planners.motion import Motion
from planners.motion.motion import Event
from planners.plan import Plan
from planners.streams.stream import Stream, StreamReport
from planners.trajectory import Trajectory
from planners.trajectory.trajectory import SAME_INSTANT, sample_states

# ---------------- set-points


PERIOD = 0.004
"""Default servo period [s]: 250 set-points per second, as for many controllers of arms."""

MOST_PERIODS = 500_000
"""Largest number of periods of a motion: half an hour at 4 ms, for which a simulated arm stores half a gigabyte."""


class Setpoints(NamedTuple):
    """The set-points of a motion: row k is its state at k periods, the last row its end.

    Attributes
    ----------
    period : float
        Servo period [s].
    t : (k,) array
        Times of the ticks, from 0 to the first tick that is not before the motion's end [s].
    q, dq, ddq : (k, n) arrays
        Positions [rad, m], velocities [rad/s, m/s] and accelerations [rad/s², m/s²].
    """

    period: float
    t: Array
    q: Array
    dq: Array
    ddq: Array


def fit_periods(plan: Plan, period: float = PERIOD) -> Plan:
    """Slow a plan uniformly to a whole number of the servo's periods, and certify it again.

    Its last set-point is then exactly its end. A plan with constant tool speed or a moving start is not stretched. Its last
    set-point is held to the end of the period.

    Parameters
    ----------
    plan : Plan
        A plan with a motion.
    period : float
        Servo period [s].

    Returns
    -------
    Plan
        The plan with a duration of n · period; the factor is `Plan.stretch_factor`.

    Raises
    ------
    NoSolution
        A plan without a motion.
    InvalidInput
        A period that is not above 0, or longer than the motion.
    """
    motion, proof = plan.trajectory, plan.certificate
    duration = count_periods(motion, period) * period
    if plan.speed is not None or not proof.rest[0] or motion.end == duration:
        return plan
    return stretch_to_duration(plan, duration)


def stretch_to_duration(plan: Plan, duration: float) -> Plan:
    """Return a plan that begins at rest, slowed uniformly to a duration and certified again."""
    motion = plan.trajectory.stretched(max(duration / plan.trajectory.duration, 1.0))
    knots = motion.knots.copy()
    knots[-1] = duration  # the last piece is shortened by the rounding error
    return plan.with_motion(Trajectory(scipy.interpolate.PPoly(motion.coefficients, knots)))


def make_setpoints(motion: Trajectory | Motion | Plan, period: float = PERIOD) -> Setpoints:
    """Return the set-points of a motion: row k is its state at k periods, or at its end.

    Parameters
    ----------
    motion : Trajectory, Motion or Plan
        The executed motion.
    period : float
        Servo period [s].

    Returns
    -------
    Setpoints
        At t = 0, period, … up to the first tick that is not before the motion's end. At a jump of the acceleration, the
        mean of both sides.

    Raises
    ------
    NoSolution
        A plan without a motion.
    InvalidInput
        A period that is not above 0, or longer than the motion.
    """
    trajectory = motion if isinstance(motion, Trajectory) else motion.trajectory
    t: Array = np.arange(count_periods(trajectory, period) + 1, dtype=np.float64) * period
    return Setpoints(period, t, *sample_states(trajectory, np.minimum(t, trajectory.end)))


def count_periods(motion: Trajectory, period: float) -> int:
    """Return the number of periods of a motion; a nanosecond more than a whole number is rounding."""
    period = check_number(period, "period", "seconds above 0", above=0.0)
    if motion.end < period - SAME_INSTANT:
        raise InvalidInput("period", f"{period:.6g} s", f"at most the duration of the motion, {motion.end:.6g} s")
    if motion.end > MOST_PERIODS * period:
        came = f"{period:.6g} s, for a motion of {motion.end:.6g} s"
        raise InvalidInput("period", came, f"at most {MOST_PERIODS:,} periods: a longer period, or higher limits")
    return max(ceil((motion.end - SAME_INSTANT) / period), 1)


# ---------------- options of all simulated drives


ENCODER = 2.0**20
"""Default counts per turn of an encoder: the 20 bits of common absolute encoders behind the gear."""
SCALE = 1e-6
"""Default resolution of a prismatic joint's encoder [m]: that of a linear scale."""
FOLLOWING = (0.05, 0.005)
"""Default of the largest difference of set-point and reading [rad, m]: far above the lag of a working servo, far below the
error of a blocked joint after a quarter of a second."""
START_AWAY = (1e-3, 1e-4)
"""Default tolerance on the start of a plan [rad, m]. A servo without integral action has this error under gravity."""
END_AWAY = (5e-3, 5e-4)
"""Default of the largest difference of set-point and reading at rest [rad, m]: several times the error of a servo without
integral action under gravity."""
HELD_AHEAD = 10
"""Default number of set-points that are sent ahead: 40 ms at 4 ms, more than the usual delays of an operating system without
real-time scheduling."""


class Options(NamedTuple):
    """The options of a simulated drive; arrays (n,) are by joint [rad, m]."""

    period: float  # of the servo [s]
    ahead: int  # number of set-points that the drive has beyond the present one
    hold: bool  # whether set-points are held for a period instead of interpolated
    resolution: Array  # of the encoders; 0 for an exact one
    noise: float  # standard deviation of the readings [rad, m]
    following: Array  # largest difference of set-point and reading during the motion
    start: Array  # largest difference of reading and a plan's start
    end: Array  # largest difference of set-point and reading at rest
    pace: float | None  # seconds of the motion per second of real time [1]; None for as fast as possible


def make_options(
    robot: Robot, *, period: float = PERIOD, ahead: int = HELD_AHEAD, hold: bool = False,
    encoder: float | ArrayLike = ENCODER, encoder_noise: float = 0.0,
    following: ArrayLike | None = None, start_tolerance: ArrayLike | None = None,
    end_tolerance: ArrayLike | None = None, pace: float | None = None,
) -> Options:  # fmt: skip
    """Return the checked options of a simulated drive."""
    period = check_number(period, "period", "seconds above 0", above=0.0)
    check_count(ahead, "ahead", 1)
    noise = check_number(encoder_noise, "encoder_noise", "a standard deviation, at least 0", least=0.0)
    if pace is not None:
        pace = check_number(pace, "pace", "a number above 0, or None", above=0.0)
    return Options(
        period, ahead, check_flag(hold, "hold"), _resolution(robot, encoder), noise,
        by_joint(robot, following, "following", FOLLOWING),
        by_joint(robot, start_tolerance, "start_tolerance", START_AWAY),
        by_joint(robot, end_tolerance, "end_tolerance", END_AWAY), pace,
    )  # fmt: skip


def by_joint(
    robot: Robot, value: ArrayLike | None, argument: str, default: tuple[float, float] = (np.nan, np.nan)
) -> Array:
    """Return one number above 0 for each joint; the default is that of revolute and of prismatic joints."""
    if value is None:
        return np.where(robot.prismatic, default[1], default[0])
    return np.broadcast_to(_check_positive(robot, value, argument, "a number above 0"), (robot.n,)).copy()


def _check_positive(robot: Robot, value: ArrayLike, argument: str, wanted: str) -> Array:
    """Return a number above 0, or one for each joint, as an array () or (n,)."""
    wanted = f"{wanted}, or {robot.n} of them"
    array = real_array(value, argument, wanted)
    if array.shape not in ((), (robot.n,)) or not (array > 0.0).all():
        raise InvalidInput(argument, repr(value)[:60], wanted)
    return array


def _resolution(robot: Robot, encoder: ArrayLike) -> Array:
    """Return the resolution of each encoder [rad, m]."""
    array = _check_positive(robot, encoder, "encoder", "a number of counts per turn above 0")
    turn = 2.0 * pi / array
    if array.shape == ():
        return np.where(robot.prismatic, SCALE if np.isfinite(array) else 0.0, turn)
    return np.where(robot.prismatic, np.where(np.isfinite(array), array, 0.0), turn)


# ---------------- the record of a stream


class StreamRecord(NamedTuple):
    """The record of a stream on a drive; it is true if nothing stopped the stream.

    Attributes
    ----------
    t : (k,) array
        Times of the set-points [s].
    setpoints, q : (k, n) arrays
        The set-points, and the measured positions at their times [rad, m].
    report : StreamReport
        What the stream did.
    fault : str
        Why the stream was stopped, for example an exception of its source; empty if it was not stopped.
    """

    t: Array
    setpoints: Array
    q: Array
    report: StreamReport
    fault: str = ""

    def __bool__(self) -> bool:
        return not self.fault

    @property
    def error(self) -> Array:
        """Largest distance of each joint from its set-points (n,) [rad, m]."""
        return np.asarray(np.abs(self.q - self.setpoints).max(axis=0))


def make_record(rows: list[tuple[float, Array, Array]], stream: Stream, fault: str) -> StreamRecord:
    """Return the record of a stream; its fault is that of the arm, or else the exception of the source."""
    t, setpoints, q = (np.array(x) for x in zip(*rows, strict=True))
    if not fault and (error := stream.error):
        fault = f"{type(error).__name__}: {error}"
    return StreamRecord(t, setpoints, q, stream.report(), fault)


# ---------------- drive


class ExecutionStatus(StrEnum):
    """The status of an execution. Only DONE is success; the arm is at rest in all of them as far as the drive knows.

    DONE: the arm was taken to the end of the plan. STOPPED: it was stopped on request, on the path. FAULT: a fault stopped
    it. REFUSED: nothing was sent, because a check before the start failed. DRY_RUN: all checks passed, and nothing was sent.
    """

    DONE = "done"
    STOPPED = "stopped"
    FAULT = "fault"
    REFUSED = "refused"
    DRY_RUN = "dry_run"


class FaultKind(StrEnum):
    """The kind of a fault.

    STALL: a joint that does not follow. ENCODER: a lost or frozen encoder.
    CONNECTION: a lost connection. CONTROLLER: a controller that rejected
    a goal or ended it.
    """

    STALL = "stall"
    ENCODER = "encoder"
    CONNECTION = "connection"
    CONTROLLER = "controller"


class Fault(NamedTuple):
    """A fault: its kind, time [s], joint (None for all), reason, and advice before resuming."""

    kind: FaultKind
    t: float
    joint: str | None
    reason: str
    advice: str


class Moment(NamedTuple):
    """The state of an execution at one tick, for a watcher.

    ``t`` is the time since its start [s]; the configurations are (n,) [rad, m]. The actual configuration is that of the
    simulated plant; on a real arm it is the measured one. ``events`` are those since the tick before.
    """

    t: float
    setpoint: Array
    measured: Array
    actual: Array
    events: tuple[Event, ...] = ()


StopRequest = float | Callable[[float], bool]
"""When to stop: a time since the start [s], or a function of that time, called at every tick."""
Watcher = Callable[[Moment], None]
"""A function that is called at every tick, for example by a viewer."""


@dataclass(frozen=True, eq=False)
class Execution:
    """The record of an execution. ``bool(execution)`` is success: the arm reached the end of the plan.

    Attributes
    ----------
    drive : str
        Name of the drive.
    robot : Robot
        The arm of the plan.
    status : ExecutionStatus
        DONE, or another status.
    reason, advice : str
        Why the status is not DONE, and what to try; empty for DONE.
    plan : Plan
        The executed plan, stretched to a whole number of periods if it has no requested speed.
    stop_plan : Plan or None
        The certified stop that replaced the remaining motion.
    motion : Trajectory or None
        The continuous motion whose set-points were sent: that of the plan, or the plan's up to the stop and then the stop;
        None if nothing was sent.
    setpoints : Setpoints or None
        Set-points sent at each tick up to the last recorded one; the last one repeats while the plant settles.
    t : (m,) array
        Times of the plant's steps from 0, or of the ticks of a real drive [s].
    q, dq : (m, n) arrays
        True positions [rad, m] and velocities [rad/s, m/s] of the arm at these times; the measured ones of a real drive.
        NaN of a simulated arm that was refused its first plan and has no configuration yet.
    torque : (m, n) array or None
        Torques of the motors at these times [N·m, N]; None if the plant has no torques.
    measured : (k, n) array
        Encoder readings at the ticks [rad, m].
    late : int
        Number of ticks whose next set-point arrived late.
    fault : Fault or None
        The fault, if the status is FAULT.
    notes : tuple of str
        Remarks for the reader: defaults used for unknown values, and what the drive does not guarantee.
    before : Execution or None
        After `Drive.resume`, the motion back to the path, if the arm was off it.
    events : tuple of Event
        The events of the plan that came.
    """

    drive: str
    robot: Robot
    status: ExecutionStatus
    reason: str
    advice: str
    plan: Plan
    stop_plan: Plan | None
    motion: Trajectory | None
    setpoints: Setpoints | None
    t: Array
    q: Array
    dq: Array
    torque: Array | None
    measured: Array
    late: int = 0
    fault: Fault | None = None
    notes: tuple[str, ...] = field(default=())
    before: Execution | None = None
    events: tuple[Event, ...] = ()

    def __bool__(self) -> bool:
        return self.status is ExecutionStatus.DONE


class Drive(ABC):
    """The base class of drives, which execute plans on one arm. A drive is a subclass in its own file, named ``METHOD``.

    Attributes
    ----------
    name : str
        Name of its file, by which it is found. A class without a file has its class name in lower case.
    simulated : bool
        Whether the arm is simulated.
    robot : Robot
        The arm that it drives.
    period : float
        Servo period [s].
    """

    name: ClassVar[str] = ClassName()  # type: ignore[assignment] # read as a str
    simulated: ClassVar[bool] = False
    robot: Robot
    period: float

    @abstractmethod
    def measure(self) -> Array:
        """Return the encoders' configuration now (n,) [rad, m]; NaN for a joint whose encoder is lost."""

    @abstractmethod
    def execute(
        self, plan: Plan, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Take the arm along a valid plan.

        Parameters
        ----------
        plan : Plan
            A plan that starts at rest at the arm's present configuration.
        stop : float or callable, optional
            When to stop on the path: a time [s], or a function of the time, called at every tick.
        watch : callable, optional
            A function that is called with a `Moment` at every tick.
        allow : str or several
            Violations of the plan to permit, as for `planners.save`.

        Returns
        -------
        Execution
            The motion of the arm until it is at rest. REFUSED if the plan is invalid; the advice names the words that
            permit its violations.

        Raises
        ------
        InvalidInput
            A plan of another arm, or one that is shorter than the period.
        """

    @abstractmethod
    def resume(
        self, execution: Execution, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Move the arm from its present configuration to the goal of a stopped execution.

        Parameters
        ----------
        execution : Execution
            An execution of this drive with the status STOPPED or FAULT.
        stop, watch, allow
            As in `execute`.

        Returns
        -------
        Execution
            The remaining motion; REFUSED if the arm has moved since the stop.

        Raises
        ------
        InvalidInput
            An execution that was not stopped.
        """

    def follow(self, stream: Stream) -> StreamRecord:
        """Execute a stream to its end at rest; stop it if a joint does not follow or the source raises an exception.

        A simulated drive takes the set-points, one for each period. A drive of ROS sends each motion as it is joined.

        Parameters
        ----------
        stream : Stream
            Of `planners.stream`, which begins at the arm's present configuration.

        Returns
        -------
        StreamRecord
            Set-points, measured positions, the stream's report, and the fault.

        Raises
        ------
        InvalidInput
            A stream of another rate or start, or a drive that takes no streams.
        """  # noqa: DOC202
        raise InvalidInput("drive", self.name, "a drive that takes streams, such as 'mujoco'")

    def _actual(self) -> Array:
        """Return the true configuration of the arm (n,) [rad, m]; of a real arm the measured one."""
        return self.measure()

    def carry(self, robot: Robot) -> None:
        """Change tool, payload and shapes of the arm at rest.

        A simulated drive with a model of its own overrides this to change the model, too.

        Parameters
        ----------
        robot : Robot
            The same arm with its new load.

        Raises
        ------
        InvalidInput
            Another arm.
        """
        if _unload(robot) != _unload(self.robot):
            raise InvalidInput("robot", f"{robot.name!r}, another arm", f"{self.robot.name!r} with another load")
        self.robot = robot


def _unload(robot: Robot) -> Robot:
    """Return the arm without payload, tool and shapes."""
    return robot.with_payload(None).with_tool(np.eye(4)).with_shapes(None)


METHOD_BASE = Drive
"""The base class of the METHOD of every module here and of every plug-in."""
