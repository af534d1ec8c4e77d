"""Joint trajectories of other programs: setpoints from CSV, JSON or ROS messages, and the trajectory through them."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.file_io import check_suffix, decode_text, read_bytes
from optik.types import Array
from planners.controller import INTERPOLATIONS, trajectory_through
from planners.ros.message import from_text, reconstruct
from planners.trajectory import Trajectory

READ_SUFFIXES = (".csv", ".json", ".yaml", ".yml")
"""Suffixes of the files that can be read."""
WRAPPED = ("joint_trajectory", "trajectory")
"""Keys under which messages hold a JointTrajectory: moveit_msgs/RobotTrajectory, and actions and services around one."""
COLUMN_KINDS = (("", "q_", "position_", "positions_"), ("dq_", "velocity_", "v_"), ("ddq_", "acceleration_", "a_"))
"""Prefixes of a joint's name in a column, by order of derivative."""
TIME_COLUMNS = ("t", "time", "times", "time_from_start")
"""Names of the column of times [s]."""


def load_trajectory(
    file: str | os.PathLike[str],
    robot: Robot,
    *,
    joint_names: Mapping[str, str] | None = None,
    interpolation: str | None = None,
) -> Trajectory:
    """Read setpoints that another program wrote, without path and limits; `planners.certify` takes them with ``path=None``.

    Parameters
    ----------
    file : str or path
        ``.csv``: a header with a column ``t`` or ``time`` [s] and one for each joint by its name; velocities and
        accelerations in columns ``dq_NAME`` and ``ddq_NAME`` (or ``velocity_``, ``acceleration_``), where there are any.
        ``.json``: ``joint_names``, ``times`` (k,) [s], ``positions`` (k, n), perhaps ``velocities``, ``accelerations``; or a
        message. ``.yaml``, ``.yml``: a ``trajectory_msgs/JointTrajectory``, or a ``moveit_msgs/RobotTrajectory`` around one.
    robot : Robot
        The arm; its joint names, or those of ``joint_names``, must be the file's, in any order.
    joint_names : mapping, optional
        From the robot's joint names to the file's.
    interpolation : {"linear", "cubic", "quintic"}, optional
        Controller interpolation: lines through positions, cubics through velocities too, or quintics through accelerations
        too. By default the highest that the points have data for, like joint_trajectory_controller of ROS 2.

    Returns
    -------
    Trajectory
        In the robot's joint order, from t = 0.

    Raises
    ------
    InvalidInput
        No such file, other joints, times that do not increase, NaN, an interpolation that the points have no data for.
    MissingDependency
        YAML without PyYAML.
    """
    suffix = check_suffix(file, READ_SUFFIXES)
    if not isinstance(robot, Robot):
        raise InvalidInput("robot", repr(robot)[:60], "a Robot")
    if interpolation is not None and interpolation not in INTERPOLATIONS:
        raise InvalidInput("interpolation", repr(interpolation)[:60], f"one of {', '.join(INTERPOLATIONS)}")
    names = _check_names(robot, joint_names)
    content = read_bytes(FilePath(file))
    try:
        text = decode_text(content)
        if suffix == ".csv":
            return _build_trajectory(*_read_table(text, names), interpolation)
        data = _unwrap(from_text(text, suffix))
        if isinstance(data, dict) and "times" in data:
            return _build_trajectory(*_read_columns(data, names), interpolation)
        return reconstruct(data, names, interpolation)
    except InvalidInput as error:
        raise InvalidInput(f"{file}: {error.argument}", error.got, error.expected) from None


def _check_names(robot: Robot, joint_names: Mapping[str, str] | None) -> list[str]:
    """Return the file's joint names in the robot's order."""
    if joint_names is None:
        return list(robot.joint_names)
    if not isinstance(joint_names, Mapping) or set(joint_names) != set(robot.joint_names):
        raise InvalidInput("joint_names", repr(joint_names)[:120], f"names for each of {', '.join(robot.joint_names)}")
    return [str(joint_names[name]) for name in robot.joint_names]


def _unwrap(data: Any) -> Any:
    """Return the JointTrajectory inside a message, or the data themselves."""
    while isinstance(data, dict) and "points" not in data and "times" not in data:
        inner = [data[key] for key in WRAPPED if isinstance(data.get(key), dict)]
        if not inner:
            return data
        data = inner[0]
    return data


def _build_trajectory(t: Array, orders: list[Array], interpolation: str | None) -> Trajectory:
    """Return the trajectory through setpoints at t (k,): positions, and optional velocities and accelerations, (k, n) each."""
    if t.size < 2 or t[0] != 0.0 or not (np.diff(t) > 0.0).all():
        raise InvalidInput(
            "times", f"{t.size} from {t[0] if t.size else 'none'}", "at least two, that increase from 0 s"
        )
    for values in (t, *orders):
        if not np.isfinite(values).all():
            raise InvalidInput("content", "NaN or infinity", "finite numbers")
    count = len(orders) if interpolation is None else INTERPOLATIONS.index(interpolation) + 1
    if count > len(orders):
        raise InvalidInput("interpolation", repr(interpolation), f"{', '.join(INTERPOLATIONS[: len(orders)])}")
    return trajectory_through(t, *orders[:count])


def _read_columns(data: dict[str, Any], names: list[str]) -> tuple[Array, list[Array]]:
    """Return times, and values by order of derivative, of columns in JSON."""
    found = data.get("joint_names")
    if not isinstance(found, list) or sorted(map(str, found)) != sorted(names):
        raise InvalidInput("joint_names", repr(found)[:120], f"{', '.join(names)} in any order")
    t = _read_numbers(data["times"], "times", 1)
    order = [found.index(name) for name in names]
    orders = []
    for key in ("positions", "velocities", "accelerations"):
        if data.get(key):
            values = _read_numbers(data[key], key, 2)
            if values.shape != (t.size, len(names)):
                raise InvalidInput(key, f"shape {values.shape}", f"({t.size}, {len(names)})")
            orders.append(values[:, order])
        elif key == "positions" or (key == "velocities" and data.get("accelerations")):
            raise InvalidInput(key, "none", "one row for each time")
    return t, orders


def _read_numbers(value: Any, key: str, dimensions: int) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0)
    if array.ndim != dimensions or not array.size:
        raise InvalidInput(
            key, repr(value)[:60], "numbers" if dimensions == 1 else "rows of numbers, all of one length"
        )
    return array


def _read_table(text: str, names: list[str]) -> tuple[Array, list[Array]]:
    """Return times, and values by order of derivative, of a CSV table; lines that begin with # are comments."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    try:
        rows = list(csv.reader(io.StringIO("\n".join(lines)), skipinitialspace=True))
    except csv.Error as error:
        raise InvalidInput("table", str(error), "comma-separated values") from None
    header = [name.strip() for name in rows[0]] if rows else []
    times = [i for i, name in enumerate(header) if name.lower() in TIME_COLUMNS]
    if len(times) != 1:
        raise InvalidInput("table", ", ".join(header)[:120], f"one column of times: {' or '.join(TIME_COLUMNS)}")
    chosen = [_find_columns(header, kind, names) for kind in COLUMN_KINDS]
    if chosen[0] is None or (chosen[1] is None and chosen[2] is not None):
        raise InvalidInput(
            "table", ", ".join(header)[:120], f"a column for each of {', '.join(names)}; see load_trajectory"
        )
    known = {times[0], *(i for columns in chosen if columns for i in columns)}
    if len(known) < len(header):
        other = ", ".join(name for i, name in enumerate(header) if i not in known)
        raise InvalidInput("table", f"the columns {other}"[:120], "only times and this arm's joints")
    if any(len(row) != len(header) for row in rows[1:]):
        raise InvalidInput("table", "rows of several lengths", f"{len(header)} entries in each")
    try:
        values = np.array(rows[1:], dtype=np.float64).reshape(-1, len(header))
    except ValueError as error:
        raise InvalidInput("table", str(error)[:80], "numbers") from None
    return values[:, times[0]], [values[:, columns] for columns in chosen if columns is not None]


def _find_columns(header: list[str], prefixes: tuple[str, ...], names: list[str]) -> list[int] | None:
    """Return the columns of the joints with one of the prefixes; None if there are none."""
    for prefix in prefixes:
        if all(prefix + name in header for name in names):
            return [header.index(prefix + name) for name in names]
    return None
