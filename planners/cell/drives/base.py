"""Drive, the base class that executes certified plans on a simulated or real arm; Execution, the record of the motion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.registry import ClassName
from optik.types import Array
from planners.cell.drives._stream_record import StreamRecord
from planners.cell.drives.setpoints import Setpoints
from planners.certificate.violation import Allow
from planners.motion.event import Event
from planners.plan import Plan
from planners.retarget.stream import Stream
from planners.trajectory import Trajectory


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
        The executed plan, slowed to a whole number of periods if it has no requested speed.
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
