"""Messages of ROS 2 from a controller as plain data, checked because other programs wrote them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from optik.errors import InvalidInput
from optik.scene.files import NANOSECONDS, read_fields, read_time
from optik.types import Array

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
