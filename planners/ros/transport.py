"""Transport, a connection to a controller of ROS 2 for goals and joint states; Goal, a sent goal."""

from __future__ import annotations

import threading
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np

from optik.errors import InvalidInput
from optik.scene.files import NANOSECONDS, read_fields, read_time
from optik.types import Array

# ---------------- messages of a controller as plain data, checked because other programs wrote them


ACTION = "/joint_trajectory_controller/follow_joint_trajectory"
"""Action of the joint_trajectory_controller with the name in its documentation."""
ACTION_TYPE = "control_msgs/action/FollowJointTrajectory"
"""Type of that action."""
STATES = "/joint_states"
"""Topic of the joint_state_broadcaster."""
STATES_TYPE = "sensor_msgs/msg/JointState"
"""Type of its messages."""


class GoalState(IntEnum):
    """The final state of a goal, with the numbers of ``action_msgs/GoalStatus``."""

    UNKNOWN = 0
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class States(NamedTuple):
    """A ``sensor_msgs/JointState``: its stamp [ns], names, positions and velocities; NaN for missing numbers."""

    stamp: int
    names: tuple[str, ...]
    positions: Array
    velocities: Array


class Feedback(NamedTuple):
    """The desired state in the feedback of a controller: its stamp [ns], names, positions, velocities, accelerations.

    Accelerations are None if it sends none.
    """

    stamp: int
    names: tuple[str, ...]
    positions: Array
    velocities: Array
    accelerations: Array | None


class Result(NamedTuple):
    """The result of a goal: its final state, and the controller's error code and text."""

    state: GoalState
    code: int
    words: str


def read_states(message: Any) -> States:
    """Read a ``sensor_msgs/JointState``."""
    message = read_fields(message, "joint state")
    names = _names(message.get("name"), "name")
    positions = read_reply_numbers(message.get("position"), len(names), "position")
    given = message.get("velocity")
    velocities = read_reply_numbers(given, len(names), "velocity") if given else np.full(len(names), np.nan)
    return States(read_stamp(message, "joint state"), names, positions, velocities)


def read_feedback(values: Any) -> Feedback:
    """Read the feedback of a ``FollowJointTrajectory`` goal."""
    values = read_fields(values, "feedback")
    names = _names(values.get("joint_names"), "joint_names")
    desired = read_fields(values.get("desired"), "desired")
    rows: dict[str, Array] = {}
    for field in ("positions", "velocities", "accelerations"):
        given = desired.get(field)
        if given or field == "positions":
            rows[field] = read_reply_numbers(given, len(names), f"desired.{field}")
            if not np.isfinite(rows[field]).all():
                raise InvalidInput(f"desired.{field}", repr(given)[:80], "finite numbers")
    velocities = rows.get("velocities", np.full(len(names), np.nan))
    return Feedback(read_stamp(values, "feedback"), names, rows["positions"], velocities, rows.get("accelerations"))


def read_result(state: Any, values: Any) -> Result:
    """Read the result of a ``FollowJointTrajectory`` goal."""
    values = read_fields(values, "result")
    if isinstance(values.get("result"), Mapping):
        state, values = values.get("status", state), values["result"]
    known = [each.value for each in GoalState]
    code, words = values.get("error_code", 0), values.get("error_string", "")
    if type(code) is not int or not isinstance(words, str):
        raise InvalidInput("result", repr(dict(values))[:80], "an integer error_code and an error_string")
    return Result(GoalState(state) if type(state) is int and state in known else GoalState.UNKNOWN, code, words[:200])


def read_stamp(message: Mapping[str, Any], what: str) -> int:
    """Read the time stamp of a message's header."""
    header = read_fields(message.get("header", {}), f"{what}.header")
    return read_time(header.get("stamp", {}), f"{what}.header.stamp")


def write_time(stamp: int) -> dict[str, int]:
    """Return a time as a ROS time."""
    return {"sec": stamp // NANOSECONDS, "nanosec": stamp % NANOSECONDS}


def read_reply_numbers(values: Any, count: int, field: str) -> Array:
    """Read a list of numbers; null, which JSON writes for NaN, is NaN."""
    good = isinstance(values, list | tuple) and len(values) == count
    if good and all(value is None or type(value) in (int, float) for value in values):
        try:
            return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
        except OverflowError:  # an integer beyond all floats
            pass
    raise InvalidInput(field, repr(values)[:80], f"{count} numbers")


def check_ros_name(name: str, argument: str) -> str:
    """Check the name of a topic or an action."""
    parts = name.removeprefix("/").split("/") if isinstance(name, str) else [""]
    if not all(part.isidentifier() and part.isascii() for part in parts):
        raise InvalidInput(argument, repr(name)[:80], "a name of ROS, such as /joint_states")
    return name


def _names(value: Any, field: str) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or not value or not all(isinstance(name, str) for name in value):
        raise InvalidInput(field, repr(value)[:80], "names of joints")
    if len(set(value)) != len(value):
        raise InvalidInput(field, repr(value)[:80], "different names of joints")
    return tuple(value)


# ---------------- goals and joint states


class JointReading(NamedTuple):
    """The latest state of one joint: position [rad, m] and velocity [rad/s, m/s], NaN if the driver sent none.

    It is fresh if its stamp is later than that of the previous reading, or if it has no stamp. The first reading is not fresh,
    because it may be a repeated message.
    """

    position: float
    velocity: float
    stamp: int  # time of the measurement by the robot's clock [ns]; 0 without a stamp
    at: float  # arrival by this machine's clock, as `time.monotonic` [s]
    fresh: bool


class Goal:
    """A sent goal: whether it was accepted, its latest feedback, and its result. A transport updates it."""

    def __init__(self) -> None:
        self.id = f"optik-{uuid.uuid4()}"
        self.accepted = False  # whether the controller is known to have accepted it
        self.refused = ""  # why it was not accepted; empty if that is not known
        self.odd = ""  # error of the latest message about it that could not be read
        self.feedback: Feedback | None = None  # the latest one
        self.first: Feedback | None = None
        self.result: Result | None = None  # once the goal has ended
        self.heard = 0.0  # arrival of the latest feedback, as `time.monotonic` [s]
        self._changed = threading.Condition()

    @property
    def ended(self) -> bool:
        """Whether the goal was refused or has its result."""
        return bool(self.refused) or self.result is not None

    def wait(self, until: Callable[[], bool], seconds: float) -> bool:
        """Wait until a condition, checked after every change of this goal, is true, or for some seconds; return its value."""
        with self._changed:
            return self._changed.wait_for(until, max(seconds, 0.0))

    def tell_accepted(self) -> None:
        """Record that the controller accepted the goal."""
        self._set(accepted=True)

    def tell_refused(self, reason: str) -> None:
        """Record why the controller did not accept the goal; an accepted goal then ends as UNKNOWN."""
        said = " ".join(reason.split())[:300] or "no reason was given"
        if self.accepted:
            self._set(result=Result(GoalState.UNKNOWN, 0, f"no result: {said}"))
        else:
            self._set(refused=said)

    def tell_feedback(self, values: Any) -> None:
        """Record a feedback message of the controller, given as plain data; feedback implies that the goal was accepted."""
        try:
            feedback = read_feedback(values)
            self._set(accepted=True, first=self.first or feedback, feedback=feedback, heard=time.monotonic())
        except InvalidInput as error:
            self._set(accepted=True, odd=str(error))

    def tell_result(self, state: Any, values: Any) -> None:
        """Record the state of ``action_msgs/GoalStatus`` and the result as plain data.

        The result is UNKNOWN if it cannot be read, because the goal has ended in any case.
        """
        try:
            self._set(accepted=True, result=read_result(state, values))
        except InvalidInput as error:
            self._set(odd=str(error), result=Result(GoalState.UNKNOWN, 0, f"a result that cannot be read: {error}"))

    def _set(self, **values: Any) -> None:
        with self._changed:
            for name, value in values.items():
                setattr(self, name, value)
            self._changed.notify_all()


class Transport(ABC):
    """A connection that carries goals to a controller and joint states back.

    Its methods return at once, and raise no errors of the other side: these are in `lost` and `odd`.

    Attributes
    ----------
    address : str
        Address of the controller, for messages.
    lost : str
        Why there is no connection; empty while there is one.
    odd : str
        Error of the latest message that could not be read; empty if there was none.
    readings : dict of str to Reading
        The latest state of each joint, by the controller's joint name.
    """

    address: str = ""

    def __init__(self) -> None:
        self.lost, self.odd = "", ""
        self.readings: dict[str, JointReading] = {}

    @abstractmethod
    def send(self, trajectory: dict[str, Any]) -> Goal:
        """Send a ``FollowJointTrajectory`` goal once; without a connection it is not sent later.

        Parameters
        ----------
        trajectory : dict
            A ``trajectory_msgs/JointTrajectory`` as plain data.

        Returns
        -------
        Goal
            The sent goal.
        """

    @abstractmethod
    def cancel(self, goal: Goal) -> None:
        """Ask the controller to cancel a goal, which then gets its result.

        Parameters
        ----------
        goal : Goal
            A goal sent by this transport.
        """

    @abstractmethod
    def close(self) -> None:
        """End the connection; accepted goals continue on the controller."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def tell_states(self, message: Any) -> None:
        """Record joint states.

        Parameters
        ----------
        message : dict
            A ``sensor_msgs/JointState`` as plain data.
        """
        try:
            states = read_states(message)
        except InvalidInput as error:
            self.odd = str(error)
            return
        now, readings = time.monotonic(), dict(self.readings)
        for name, position, velocity in zip(*states[1:], strict=True):
            before = readings.get(name)
            fresh = before is not None and (states.stamp > before.stamp or states.stamp == 0)
            if before is None or fresh:  # a message with an old stamp is a repetition
                readings[name] = JointReading(float(position), float(velocity), states.stamp, now, fresh)
        self.readings = readings  # replaced as a whole, for readers in other threads
