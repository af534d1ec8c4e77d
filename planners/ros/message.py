"""The message trajectory_msgs/JointTrajectory as plain data and as text, and its motion after controller interpolation."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.arm.motors import Motors
from optik.arm.plain import read_list
from optik.errors import InvalidInput
from optik.file_io import parse_json, parse_yaml
from optik.scene.files import NANOSECONDS, read_floats, read_time
from optik.types import Array
from planners.ros.replies import write_time
from planners.trajectory import Trajectory
from planners.trajectory.trajectory import count_derivatives, sample_states, trajectory_through

Times = NDArray[np.int64]
POINT_FIELDS = ("positions", "velocities", "accelerations")
"""Fields of a point that controllers interpolate through, by order of derivative."""


class Form(NamedTuple):
    """The form of a message: its interpolation, the index of each written name, its frame, and motors that are written."""

    interpolation: str
    columns: dict[str, int]
    frame_id: str = ""
    motors: Motors | None = None

    @property
    def names(self) -> list[str]:
        """The written names in the order of the robot's joints."""
        return sorted(self.columns, key=lambda name: self.columns[name])


def message_of(trajectory: Trajectory, times: Times, form: Form, stops: Array | tuple[()] = ()) -> dict[str, Any]:
    """Return the message with a trajectory's exact states at some times, at rest at its stops (k,) [s]."""
    t, order = times / NANOSECONDS, list(form.columns.values())
    states = list(sample_states(trajectory, t)[: count_derivatives(form.interpolation)])
    for stop in stops:  # times in whole nanoseconds are next to it, where the acceleration may be discontinuous
        for state in states[1:]:
            state[np.abs(times - stop * NANOSECONDS) <= 1.0] = 0.0
    if form.motors is not None:
        states = [form.motors.of(x, k) for k, x in enumerate(states)]
    values: list[Any] = [x[:, order].tolist() for x in states]
    values += [[[]] * t.size] * (len(POINT_FIELDS) - len(values))
    points = [
        {**dict(zip(POINT_FIELDS, point, strict=True)), "effort": [], "time_from_start": write_time(int(ns))}
        for ns, *point in zip(times, *values, strict=True)
    ]
    header = {"stamp": write_time(0), "frame_id": form.frame_id}  # a stamp of 0 is "now" to the controller
    return {"header": header, "joint_names": list(form.columns), "points": points}


RATES = ("rad", "rad/s", "rad/s2", "m", "m/s", "m/s2")
"""Units of messages."""


class MessagePoints(NamedTuple):
    """Setpoints: times (k,) [s] after the first one, which is at `begin` [s], and values (k, n) by order of derivative.

    `from_start` is True if the clock starts with the motion; `locate` names a row, or a joint's value in it, for errors;
    `notes` lists assumptions, `assumed` the units, such as s and rad, that the file does not state, and `stated` those it does.
    """

    t: Array
    begin: float
    values: list[Array]
    from_start: bool
    locate: Callable[..., str]
    notes: list[str]
    assumed: Collection[str] = RATES
    stated: Collection[str] = ()


def reconstruct(message: Any, names: list[str]) -> Trajectory:
    """Return the motion of a message after interpolation by ROS 2's joint_trajectory_controller.

    Between two points it interpolates by quintics if both have velocities and accelerations, by cubics if both have
    velocities, and linearly otherwise (ros2_controllers, trajectory.cpp, interpolate_between_points).
    """
    found = read_points(message, names)
    return trajectory_through(found.t, *found.values)


def read_points(message: Any, names: list[str], ignore: Collection[str] = ()) -> MessagePoints:
    """Return the setpoints of a message, or of columns: ``times`` or ``time_from_start``, ``positions`` and others."""
    if not isinstance(message, dict):
        raise InvalidInput("content", repr(message)[:60], "a message with joint_names and points")
    order = order_joints(message.get("joint_names"), names, ignore)
    points, clock = message.get("points"), "times" if "times" in message else "time_from_start"
    if (times := message.get(clock)) is not None:
        rows = {field: message[field] for field in POINT_FIELDS if message.get(field)}
        for field, row in rows.items():
            read_list(row, field, f"{len(times)} rows, one for each time", len(read_list(times, clock)))
        points = [dict(zip(rows, row, strict=True)) for row in zip(*rows.values(), strict=True)]
    if not isinstance(points, list) or not points or not all(isinstance(p, dict) for p in points):
        raise InvalidInput("points", repr(points)[:60], "a list of at least one point")
    fields = [f for f in POINT_FIELDS if f == "positions" or any(p.get(f) for p in points)]
    if fields == ["positions", "accelerations"]:
        raise InvalidInput("points", "accelerations without velocities", "velocities, too")
    count, values = len(message["joint_names"]), []
    for field in fields:
        for i in [i for i, p in enumerate(points) if not p.get(field)][:1]:
            raise InvalidInput(f"points[{i}].{field}", "none", f"{count} numbers, in all points or in none")
        read = [read_floats(p.get(field), f"points[{i}].{field}", count) for i, p in enumerate(points)]
        values.append(np.array(read)[:, order])
    since = [p.get(clock, {}) for p in points] if times is None else times
    locate, from_start = (f"points[{{}}].{clock}" if times is None else f"{clock}[{{}}]").format, clock != "times"
    if times is not None and not any(isinstance(x, dict) for x in times):
        t = read_floats(times, clock, len(points))
        return MessagePoints(t - t[0], float(t[0]), values, from_start, locate, [], ("s", *RATES))
    ns = np.array([read_time(x, locate(i)) for i, x in enumerate(since)])
    return MessagePoints((ns - ns[0]) / NANOSECONDS, ns[0] / NANOSECONDS, values, from_start, locate, [], stated=["s"])


def order_joints(found: Any, names: list[str], ignore: Collection[str]) -> list[int]:
    """Return the index of each joint among the joints of a message; others must be ignored."""
    listed = list(map(str, found)) if isinstance(found, list) else []
    others = [name for name in listed if name not in names and name not in ignore]
    if len(set(listed)) != len(listed) or not set(names) <= set(listed) or others:
        got = f"{', '.join(others)} in {', '.join(listed)}" if others else repr(found)
        advice = f"ignore={','.join(others)!r} leaves joints out" if others else ""
        advice = advice if set(names) <= set(listed) else "joint_names= gives the names in the file"
        raise InvalidInput("joint_names", got[:120], f"{', '.join(names)} in any order", advice=advice)
    for name in (name for name in ignore if name not in listed or name in names):
        wanted = f"joints of the file that are not the arm's: {', '.join(listed)}"
        raise InvalidInput("ignore", repr(name)[:60], wanted[:200])
    return [listed.index(name) for name in names]


# ---------------------------------------------------------------- text


def to_text(message: dict[str, Any], suffix: str, remarks: list[str]) -> str:
    """Return a message as text: JSON, or YAML with remarks as comments."""
    return json.dumps(message, allow_nan=False) + "\n" if suffix == ".json" else _to_yaml(message, remarks)


def from_text(text: str, suffix: str) -> Any:
    """Return the plain data of JSON or YAML."""
    return (parse_json if suffix == ".json" else parse_yaml)(text, "content")


def _to_yaml(message: dict[str, Any], remarks: list[str]) -> str:
    """Return block YAML with one line per list."""
    header = message["header"]
    lines = [f"# {remark}" for remark in remarks]
    lines += ["header:", f"  stamp: {_yaml_time(header['stamp'])}", f"  frame_id: {quote_name(header['frame_id'])}"]
    lines += ["joint_names:", *(f"- {quote_name(name)}" for name in message["joint_names"]), "points:"]
    for point in message["points"]:
        rows = [f"{field}: [{', '.join(map(_yaml_float, point[field]))}]" for field in (*POINT_FIELDS, "effort")]
        lines.append("- " + "\n  ".join([*rows, f"time_from_start: {_yaml_time(point['time_from_start'])}"]))
    return "\n".join(lines) + "\n"


def _yaml_time(time: dict[str, int]) -> str:
    return f"{{sec: {time['sec']}, nanosec: {time['nanosec']}}}"


def _yaml_float(value: float) -> str:
    """Return the shortest digits of a number, exact to the last bit; YAML 1.1, as in ROS, reads 1e-05 as text, not 1.0e-05."""
    digits, e, power = repr(value).partition("e")
    return f"{digits}.0e{power}" if e and "." not in digits else f"{digits}{e}{power}"


def quote_name(name: str) -> str:
    """Return a name in double quotes, as YAML and JSON escape it."""
    return json.dumps(name, ensure_ascii=False)
