"""Joint trajectories of other programs: setpoints from tables, JSON or ROS messages, and the trajectory through them."""

from __future__ import annotations

import os
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.arm.motors import maker_joints
from optik.arm.robot import Robot
from optik.check import locate_error
from optik.errors import InvalidInput
from optik.file_io import check_suffix, decode_text, parse_json, read_bytes
from optik.tables import Names, TextTable, read_names, read_table, warn_of_assumptions
from optik.types import Array
from planners.files import load_motion
from planners.files.base import CONTENT
from planners.motion import Motion
from planners.paths.goal import find_continuous
from planners.ros.export import MESSAGE_SUFFIXES, JointNames, find_columns
from planners.ros.message import POINT_FIELDS, Form, MessagePoints, from_text, read_points
from planners.trajectory import Trajectory, map_joints
from planners.trajectory.controller import INTERPOLATIONS, trajectory_through

READ_SUFFIXES = (".csv", *MESSAGE_SUFFIXES)
"""Suffixes of the files that can be read."""
WRAPPED = ("joint_trajectory", "trajectory")
"""Keys under which messages hold a JointTrajectory: RobotTrajectory and DisplayTrajectory of moveit_msgs, and goals."""
COLUMN_KINDS = (("", "q_", "position_", "positions_"), ("dq_", "velocity_", "v_"), ("ddq_", "acceleration_", "a_"))
"""Prefixes of a joint's name in a column, by order of derivative."""
SINCE_START = "time_from_start"
CLOCKS = ("t", "time", "times", SINCE_START)
"""Names of the column of times [s]: by any clock, or from the start of the motion, as in messages."""
TURN = 2.0 * np.pi * (1.0 + 1e-6)
"""Largest range of wrapped positions [rad]."""
SPLINE = "spline"
"""Interpolation of ROS 2's ``positions_upsampling``: cubic splines through positions, at rest at both ends."""


def load_trajectory(
    file: str | os.PathLike[str], robot: Robot, *,
    joint_names: JointNames = None, interpolation: str | None = None, start: ArrayLike | None = None,
    ignore: Names = None, unwrap: Names = None, columns: Names = None,
) -> Trajectory:  # fmt: skip
    """Read setpoints that another program wrote, without path and limits; `planners.certify` takes them with ``path=None``.

    Parameters
    ----------
    file : str or path
        ``.csv``: a table, with separators and units as in `Polyline.from_csv`: a column ``t`` or ``time`` [s], one for each
        joint by its name [rad, m], optionally ``dq_NAME`` and ``ddq_NAME`` (or ``velocity_``, ``acceleration_``). ``.json``:
        ``joint_names``, ``times`` (k,) [s], ``positions`` (k, n), optionally ``velocities``, ``accelerations``. The first time
        need not be 0. ``.json``, ``.yaml``, ``.yml``: a ``JointTrajectory`` of ROS 1 or 2, or a message that contains one.
        Of a file that `save` wrote, the exact polynomials are read, unless one of the five last options is given.
    robot : Robot
        The arm; its joint names, or those of ``joint_names``, must be the file's, in any order.
    joint_names : mapping, optional
        From the robot's joint names to the file's.
    interpolation : {"linear", "cubic", "quintic", "spline"}, optional
        Controller interpolation through the data; by default of their highest order, as in ROS 2's joint_trajectory_controller.
        ``"spline"`` is its ``positions_upsampling``: cubic splines through positions, at rest at both ends.
    start : (n,) array, optional
        Configuration at 0 s [rad, m], at rest, for a message whose first point is later.
    ignore : str or sequence of str, optional
        Joints of a message, or columns of a table, that are left out.
    unwrap : str or sequence of str, optional
        The robot's joints from whose positions jumps by whole turns are removed. By default such a jump of a joint without
        limits is refused; ``()`` accepts it.
    columns : str or sequence of str, optional
        Names of the columns of a table without a header, or new names of all columns.

    Returns
    -------
    Trajectory
        In the robot's joint order, from t = 0. Assumptions are listed in its attribute ``notes`` and in an `AssumptionWarning`.

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
    if all(x is None for x in (interpolation, start, ignore, unwrap, columns)) and (saved := read_saved(file)):
        return _check_names(saved, robot, file)
    names = Form("", find_columns(robot, joint_names)).names
    try:
        found = _read_found(FilePath(file), suffix, robot, names, columns, ignore)
        trajectory = _build(found, robot, interpolation, start, unwrap)
        if robot.motors is not None:
            trajectory = map_joints(trajectory, robot.motors.matrix, robot.motors.offset)
    except InvalidInput as error:
        own = error.argument in ("interpolation", "start", "ignore", "unwrap") or str(file) in error.argument
        raise (error if own else locate_error(file, error)) from None
    trajectory.notes = warn_of_assumptions(file, found.notes)
    return trajectory


def _read_found(
    file: FilePath, suffix: str, robot: Robot, names: list[str], columns: Names, ignore: Names
) -> MessagePoints:
    """Return the setpoints of a table or a message."""
    if suffix == ".csv":
        return _read_columns(read_table(file, columns, ignore), robot, names)
    return read_points(_unwrap(from_text(decode_text(read_bytes(file)), suffix)), names, read_names(ignore, "ignore"))


def read_saved(file: str | os.PathLike[str], *, exact: bool = True) -> Motion | None:
    """Return the motion of a file that `save` wrote; None for other files, and if `exact`, for points at a rate.

    Joints rounded to 16 digits give a piece of 1 ms a jerk that is off by 1e-5 rad/s³: the polynomials of the file are exact.
    """
    content, suffix = read_bytes(FilePath(file)), FilePath(file).suffix.lower()
    if suffix == ".csv":
        saved = content.startswith(b"# format") and not (exact and b"\n# rate: " in content)
        return load_motion(file) if saved else None
    data = parse_json(decode_text(content, str(file)), str(file)) if suffix == ".json" else None
    found = data.get("format") if isinstance(data, dict) else None
    if isinstance(found, str) and found.startswith("optik-") and found != CONTENT:
        advice = f"optik view {file} shows an execution or a failed plan"
        raise InvalidInput(
            f"{file}: format", repr(found)[:60], "setpoints, a message, or a saved motion", advice=advice
        )
    return load_motion(file) if found == CONTENT else None


def _check_names(saved: Motion, robot: Robot, file: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory of a saved motion whose joints are those of an arm."""
    if saved.robot.joint_names != robot.joint_names:
        raise InvalidInput(f"{file}: joint_names", ", ".join(saved.robot.joint_names), f"those of {robot.name}")
    return saved.trajectory


def _unwrap(data: Any) -> Any:
    """Return the JointTrajectory inside a message, or the data themselves."""
    while isinstance(data, dict) and "points" not in data and "times" not in data:
        other = data.get("multi_dof_joint_trajectory")
        if isinstance(other, dict) and other.get("points"):
            raise InvalidInput("multi_dof_joint_trajectory", f"{len(other['points'])} points", "none")
        inner = [data[key] for key in WRAPPED if isinstance(data.get(key), dict | list)]
        if not inner:
            return data
        data = inner[0]
        if isinstance(data, list):  # of a DisplayTrajectory
            if len(data) != 1:
                raise InvalidInput("trajectory", f"{len(data)} trajectories", "one")
            data = data[0]
    return data


def _build(
    found: MessagePoints, robot: Robot, interpolation: str | None, start: ArrayLike | None, unwrap: Names
) -> Trajectory:
    """Return the trajectory through setpoints."""
    t, values, first = found.t, found.values, 0
    for i in np.flatnonzero(~(np.diff(t) > 0.0))[:1]:
        got = f"{t[i + 1] + found.begin:.9g} s after {t[i] + found.begin:.9g} s"
        raise InvalidInput(found.locate(i + 1), got, "times that increase")
    if start is not None:
        q = maker_joints(robot, robot.configuration(start, "start"))
        if not found.begin > 0.0:
            got = f"a configuration, and a first point at {found.begin:.9g} s"
            raise InvalidInput("start", got, "none, or a first point after 0 s")
        t, first = np.append(0.0, t + found.begin), 1
        values = [np.vstack([np.zeros(robot.n) if k else q, rows]) for k, rows in enumerate(values)]
        found.notes.append("the arm is at rest at the start")
    elif found.begin and found.from_start:
        advice = "start=Q is the configuration at 0 s"
        raise InvalidInput(found.locate(0), f"{found.begin:.9g} s", "a first point at 0 s", advice=advice)
    elif found.begin:
        found.notes.append(f"the motion starts at the first time, {found.begin:.15g} s")
    values[0] = _remove_turns(t, values[0], robot, unwrap, lambda i: found.locate(i - first))
    if interpolation == SPLINE:  # through the points; the controller reaches the first one from the start
        spline = scipy.interpolate.CubicSpline(t[first:], values[0][first:], bc_type="clamped")
        return trajectory_through(t, values[0], np.vstack([np.zeros((first, robot.n)), spline(t[first:], 1)]))
    known = (*INTERPOLATIONS[: len(values)], SPLINE)
    if interpolation is not None and interpolation not in known:
        got = f"{interpolation!r:.60} for {', '.join(POINT_FIELDS[: len(values)])}"
        raise InvalidInput("interpolation", got, f"one of {', '.join(known)}")
    return trajectory_through(t, *values[: len(values) if interpolation is None else known.index(interpolation) + 1])


def _remove_turns(t: Array, q: Array, robot: Robot, unwrap: Names, place: Callable[[int], str]) -> Array:
    """Return positions without jumps by whole turns of some joints; by default, joints without limits must have none."""
    chosen, wrapped = read_names(unwrap, "unwrap"), q.copy()
    turning = [name for i, name in enumerate(robot.joint_names) if not robot.prismatic[i]]
    for name in (name for name in chosen if name not in turning):
        raise InvalidInput("unwrap", repr(name)[:60], f"joints of {', '.join(turning)}")
    at = [robot.joint_names.index(name) for name in chosen]
    wrapped[:, at] = np.unwrap(q[:, at], axis=0)
    jumps = (np.abs(np.diff(q, axis=0)) > np.pi) & (np.ptp(q, axis=0) <= TURN) & find_continuous(robot)
    for i, j in np.argwhere(jumps)[:1] if unwrap is None else ():
        name = robot.joint_names[j]
        got = f"a jump of {name} by {q[i + 1, j] - q[i, j]:.6g} rad at {t[i + 1]:.9g} s, nearly a turn of 2π"
        advice = f"unwrap={name!r} removes whole turns, unwrap=() accepts the jump"
        raise InvalidInput(place(i + 1), got, "continuous positions of a joint without limits", advice=advice)
    return wrapped


def _read_columns(table: TextTable, robot: Robot, names: list[str]) -> MessagePoints:
    """Return the setpoints of a table."""
    wanted = dict.fromkeys(CLOCKS, "s")
    for prefixes, per in zip(COLUMN_KINDS, ("", "/s", "/s2"), strict=True):
        for name, slides in zip(names, robot.prismatic, strict=True):
            wanted |= {prefix + name: f"{'m' if slides else 'rad'}{per}" for prefix in prefixes}
    table = table.resolve(wanted)
    clock, chosen = [name for name in table.columns if name in CLOCKS], []
    for prefixes in COLUMN_KINDS:
        sets = ([prefix + name for name in names] for prefix in prefixes)
        chosen.append(next((columns for columns in sets if set(columns) <= set(table.columns)), []))
    expected = f"only times ({', '.join(CLOCKS)}) and a column for each of {', '.join(names)}; see load_trajectory"
    if len(clock) != 1 or not chosen[0] or (chosen[2] and not chosen[1]):
        raise table.make_header_error(expected)
    table.refuse_others([*clock, *chosen[0], *chosen[1], *chosen[2]], expected)
    if len(table.lines) < 2:
        raise InvalidInput(table.file, f"{len(table.lines)} rows", "at least two")
    begin, size = table.read_numbers(clock)[0, 0], table.columns[clock[0]].size
    times = [Decimal(table.read_cells(row, clock)[0].replace(",", ".")) for row in range(len(table.lines))]
    t = np.array([float(time - times[0]) * size for time in times])  # exact for times since 1970, too
    values = [table.read_numbers(columns) for columns in chosen if columns]
    return MessagePoints(t, begin, values, clock[0] == SINCE_START, lambda i: table.locate(i, *clock), table.notes)
