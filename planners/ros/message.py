"""The message trajectory_msgs/JointTrajectory as plain data and as text, and its motion after controller interpolation."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.errors import InvalidInput
from optik.file_io import parse_json, parse_yaml
from optik.types import Array
from planners.controller import count_derivatives, sample_states, trajectory_through
from planners.ros.replies import NANOSECONDS, write_time
from planners.trajectory import Trajectory

Times = NDArray[np.int64]


LONGEST_DURATION = 2**31 - 1
"""Longest ROS duration [s]: its seconds are a signed integer of 32 bits."""
POINT_FIELDS = ("positions", "velocities", "accelerations")
"""Fields of a point that controllers interpolate through, by order of derivative."""


class Form(NamedTuple):
    """The form of a message: its interpolation, the joint index of each written name, and its frame."""

    interpolation: str
    columns: dict[str, int]
    frame_id: str = ""

    @property
    def names(self) -> list[str]:
        """The written names in the order of the robot's joints."""
        return sorted(self.columns, key=lambda name: self.columns[name])


def message_of(trajectory: Trajectory, times: Times, form: Form) -> dict[str, Any]:
    """Return the message with a trajectory's exact states at some times."""
    t, order = times / NANOSECONDS, list(form.columns.values())
    values: list[Any] = [
        x[:, order].tolist() for x in sample_states(trajectory, t)[: count_derivatives(form.interpolation)]
    ]
    values += [[[]] * t.size] * (len(POINT_FIELDS) - len(values))
    points = [
        {**dict(zip(POINT_FIELDS, point, strict=True)), "effort": [], "time_from_start": write_time(int(ns))}
        for ns, *point in zip(times, *values, strict=True)
    ]
    header = {"stamp": write_time(0), "frame_id": form.frame_id}  # a stamp of 0 is "now" to the controller
    return {"header": header, "joint_names": list(form.columns), "points": points}


def reconstruct(message: Any, names: list[str], interpolation: str | None = None) -> Trajectory:
    """Return the motion of a message after interpolation by ROS 2's joint_trajectory_controller.

    Between two points it interpolates by quintics if both have velocities and accelerations, by cubics if both have
    velocities, and linearly otherwise (ros2_controllers, trajectory.cpp, interpolate_between_points).
    """
    if not isinstance(message, dict):
        raise InvalidInput("content", repr(message)[:60], "a message with joint_names and points")
    found, points = message.get("joint_names"), message.get("points")
    if not isinstance(found, list) or sorted(map(str, found)) != sorted(names):
        raise InvalidInput("joint_names", repr(found)[:120], f"{', '.join(names)} in any order")
    if not isinstance(points, list) or len(points) < 2 or not all(isinstance(p, dict) for p in points):
        raise InvalidInput("points", repr(points)[:60], "at least two points")
    times, order = _times(points), [found.index(name) for name in names]
    fields = [f for f in POINT_FIELDS if f == "positions" or any(p.get(f) for p in points)]
    if fields == ["positions", "accelerations"]:
        raise InvalidInput("points", "accelerations without velocities", "velocities, too")
    count = len(fields) if interpolation is None else count_derivatives(interpolation)
    if count > len(fields):
        raise InvalidInput("interpolation", repr(interpolation), f"one through {', '.join(fields)}")
    fields = fields[:count]
    return trajectory_through(times / NANOSECONDS, *(_rows(points, field, len(names))[:, order] for field in fields))


def _times(points: list[dict[str, Any]]) -> Times:
    times = np.array([_nanoseconds(p.get("time_from_start"), f"points[{i}]") for i, p in enumerate(points)])
    if times[0]:
        raise InvalidInput(
            "points[0].time_from_start",
            f"{times[0]} ns",
            "0, the start of the motion",
        )
    if (np.diff(times) <= 0).any():
        i = int(np.argmax(np.diff(times) <= 0))
        got = f"{times[i + 1]} ns after {times[i]} ns"
        raise InvalidInput(f"points[{i + 1}].time_from_start", got, "increasing times")
    return times


def _nanoseconds(time: Any, point: str) -> int:
    sec, nanosec = (time.get(k) for k in ("sec", "nanosec")) if isinstance(time, dict) else (None, None)
    if type(sec) is int and type(nanosec) is int and 0 <= sec <= LONGEST_DURATION and 0 <= nanosec < NANOSECONDS:
        return sec * NANOSECONDS + nanosec
    raise InvalidInput(f"{point}.time_from_start", repr(time)[:80], "sec and nanosec, integers from 0")


def _rows(points: list[dict[str, Any]], field: str, n: int) -> Array:
    """Return the values (k, n) of one field of all points."""
    rows = []
    for i, point in enumerate(points):
        row = point.get(field)
        try:
            good = isinstance(row, list) and len(row) == n and all(type(x) in (int, float) for x in row)
            values = np.array(row, dtype=np.float64) if good else None
        except OverflowError:  # an integer beyond all floats
            values = None
        if values is None or not np.isfinite(values).all():
            raise InvalidInput(f"points[{i}].{field}", repr(row)[:80], f"{n} finite numbers, in all points or in none")
        rows.append(values)
    return np.array(rows)


# ---------------------------------------------------------------- text


def to_text(message: dict[str, Any], suffix: str, remarks: list[str]) -> str:
    """Return a message as text: JSON, or YAML with remarks as comments."""
    return json.dumps(message, allow_nan=False) + "\n" if suffix == ".json" else _to_yaml(message, remarks)


def from_text(text: str, suffix: str) -> Any:
    """Return the plain data of JSON or YAML."""
    if suffix == ".json":
        return parse_json(text, "content")
    return parse_yaml(text, "content", "reading ROS messages from YAML")


def _to_yaml(message: dict[str, Any], remarks: list[str]) -> str:
    """Return block YAML with one line per list."""
    header = message["header"]
    lines = [f"# {remark}" for remark in remarks]
    lines += ["header:", f"  stamp: {_yaml_time(header['stamp'])}", f"  frame_id: {quoted(header['frame_id'])}"]
    lines += ["joint_names:", *(f"- {quoted(name)}" for name in message["joint_names"]), "points:"]
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


def quoted(name: str) -> str:
    """Return a name in double quotes, as YAML and JSON escape it."""
    return json.dumps(name, ensure_ascii=False)
