"""Drive: what executes a certified plan on an arm, simulated or real, and the record of what the arm did."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.drives._setpoints import Setpoints
from planners.certificate.violation import Allow
from planners.plan import Plan
from planners.timing.base import ClassName
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

    A set-point outside the limits, a joint that does not follow, a lost encoder, a late host, a connection that failed, a
    controller that did not take what was sent or ended it.
    """

    SETPOINT = "setpoint"
    STALL = "stall"
    ENCODER = "encoder"
    LATE_HOST = "late_host"
    CONNECTION = "connection"
    CONTROLLER = "controller"


class Fault(NamedTuple):
    """A fault: its kind, time, joint (None for all), reason, and what to do before resuming."""

    kind: FaultKind
    t: float
    joint: str | None
    reason: str
    advice: str


class Moment(NamedTuple):
    """The state of an execution at one tick, for a watcher.

    Time since its start [s]; set-point, measured and actual configuration (n,) [rad, m]: the actual one is that of the
    simulated plant, and the measured one on a real arm.
    """

    t: float
    setpoint: Array
    measured: Array
    actual: Array


StopRequest = float | Callable[[float], bool]
"""When to stop: a time since the start [s], or a function that is asked at every tick with that time."""
Watcher = Callable[[Moment], None]
"""Called at every tick; a viewer, for example."""


@dataclass(frozen=True, eq=False)
class Execution:
    """The record of an execution. ``bool(execution)`` is success: the arm reached the end of the plan.

    Attributes
    ----------
    drive : str
        Name of the drive.
    robot : Robot
        The arm, as it was planned for.
    status : ExecutionStatus
        How it ended.
    reason, advice : str
        Why it did not end with DONE, and what to try; empty where it did.
    plan : Plan
        What was sent: the plan, slowed to a whole number of periods where its law has no speed to keep.
    stop_plan : Plan or None
        The certified stop that replaced the remaining motion.
    motion : Trajectory or None
        The continuous motion whose set-points were sent: that of the plan, or up to the stop and the stop; None where
        nothing was sent.
    setpoints : Setpoints or None
        What was sent at each tick, up to the last one that was recorded: a plant that settles holds the end for a while.
    t : (m,) array
        Times of the plant's steps since the start, 0 first [s]; the ticks, for a real drive.
    q, dq : (m, n) arrays
        What the arm really did at them [rad, m], [rad/s, m/s]; as measured, for a real drive.
    torque : (m, n) array or None
        Torques of the motors at them [N·m, N], where the plant has torques.
    measured : (k, n) array
        Encoder readings at the ticks [rad, m].
    late : int
        Ticks at which the next set-point had not arrived in time.
    fault : Fault or None
        What stopped it, where the status is FAULT.
    notes : tuple of str
        What the reader must know: defaults that stand in for unknown values, and what the drive does not promise.
    before : Execution or None
        After `Drive.resume`, the way back to the path, where the arm stood off it.
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

    def __bool__(self) -> bool:
        return self.status is ExecutionStatus.DONE


class Drive(ABC):
    """The base class of drives, which execute plans on one arm. A drive is a subclass in its own file, named ``METHOD``.

    Attributes
    ----------
    name : str
        By which it is found: that of its file. A class outside of a file is called by its own in lower case.
    simulated : bool
        Whether it moves nothing real.
    robot : Robot
        The arm that it drives.
    period : float
        Of its servo [s].
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
            Starts at rest where the arm stands.
        stop : float or callable, optional
            When to stop on the path: a time [s], or a function that is asked at every tick.
        watch : callable, optional
            Told of every tick.
        allow : str or several
            Violations of the plan to permit, as for `planners.save`.

        Returns
        -------
        Execution
            What the arm did, up to its rest. REFUSED if the plan is invalid; the reason names the words that permit it.

        Raises
        ------
        InvalidInput
            A plan of another arm, or one that is shorter than the period.
        """

    @abstractmethod
    def resume(
        self, execution: Execution, *, stop: StopRequest | None = None, watch: Watcher | None = None, allow: Allow = ()
    ) -> Execution:
        """Go on to the goal of an execution that was stopped, from where the arm stands now.

        Parameters
        ----------
        execution : Execution
            One of this drive's that ended with STOPPED or FAULT.
        stop, watch, allow
            As in `execute`.

        Returns
        -------
        Execution
            Of the rest of the way; REFUSED where the arm no longer stands where it was stopped.

        Raises
        ------
        InvalidInput
            An execution that was not stopped.
        """

    def carry(self, robot: Robot) -> None:
        """Go on with the same arm at rest, carrying something else: another tool, payload or shapes.

        A simulated drive with a model of its own overrides this to change the model, too.

        Parameters
        ----------
        robot : Robot
            The arm with what it carries from now on.

        Raises
        ------
        InvalidInput
            Another arm.
        """
        if _unload(robot) != _unload(self.robot):
            raise InvalidInput("robot", f"{robot.name!r}, another arm", f"{self.robot.name!r}, carrying something else")
        self.robot = robot


def _unload(robot: Robot) -> Robot:
    """Return the arm without payload, tool and shapes."""
    return robot.with_payload(None).with_tool(np.eye(4)).with_shapes(None)


METHOD_BASE = Drive
"""What the METHOD of every module here, and of every plug-in, is a subclass of."""
