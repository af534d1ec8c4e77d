"""Joint trajectories of other programs: setpoints from tables, JSON or ROS messages, and the trajectory through them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.arm.limits import ask_for_degrees
from optik.arm.motors import have_same_matrix, maker_joints, maker_limits, maker_names
from optik.arm.robot import Robot
from optik.check import check_kind, locate_error
from optik.errors import InvalidInput
from optik.file_io import check_suffix, decode_text, parse_json, read_bytes
from optik.scene.files import find_mappings
from optik.tables import UNIT_SIZES, Names, find_size, read_names, read_table, split_unit, warn_of_assumptions
from optik.types import Array
from planners.files import load_motion
from planners.files.base import CONTENT
from planners.files.headers import list_units, read_log
from planners.motion import Motion
from planners.paths.goal import find_continuous
from planners.ros import export
from planners.ros.export import Form, JointNames, MessagePoints
from planners.trajectory import Trajectory, map_joints
from planners.trajectory.trajectory import INTERPOLATIONS, trajectory_through

READ_SUFFIXES = (".csv", *export.MESSAGE_SUFFIXES)
"""Suffixes of the files that can be read."""
LATEST, LONGEST_STEP = 1e11, 1e5
"""Latest time by any clock, and longest time between two setpoints [s]: larger ones are in another unit."""
ROS_TIME = 4.2e15
"""Least whole number without a unit that is a time in nanoseconds [ns]: microseconds since 1970 are smaller until 2103."""
TURN = 2.0 * np.pi * (1.0 + 1e-6)
"""Largest range of wrapped positions [rad]."""
OTHER_UNITS = {"s": "ms", "rad": "deg", "m": "mm"}
"""Examples of other units."""
SPLINE = "spline"
"""Interpolation of ROS 2's ``positions_upsampling``: cubic splines through positions, at rest at both ends."""


def load_trajectory(
    file: str | os.PathLike[str], robot: Robot, *,
    joint_names: JointNames = None, interpolation: str | None = None, start: ArrayLike | None = None,
    ignore: Names = None, unwrap: Names = None, columns: Names = None, unit: Names = None,
) -> Trajectory:  # fmt: skip
    """Read setpoints that another program wrote, without path and limits; `planners.certify` takes them with ``path=None``.

    Parameters
    ----------
    file : str or path
        ``.csv``: a table, with separators and units as in `Polyline.from_csv`: a column of times such as ``t``, ``%time`` or
        ``timestamp_ms``, one for each joint by name or number, such as ``NAME_deg``, ``/joints/NAME/position`` or ``q1``, and
        perhaps of velocities (``dq_``, ``vel_``) and accelerations (``ddq_``, ``acc_``). ``.json``: ``joint_names``, ``times``
        (k,) [s], ``positions`` (k, n), optionally ``velocities``, ``accelerations``. The first time need not be 0. ``.json``,
        ``.yaml``, ``.yml``: a ``JointTrajectory`` of ROS 1 or 2, or a message that contains one. Of a file that `save` wrote,
        the exact polynomials are read, unless an option after ``joint_names`` is given.
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
    unit : str or sequence of str, optional
        Units that the file does not state, such as ``"ms,deg"``; by default s, rad and m, which ``()`` states, too. Rates
        without a unit have that of the positions.

    Returns
    -------
    Trajectory
        In the robot's joint order, from t = 0. Assumptions are listed in its attribute ``notes`` and in an `AssumptionWarning`.

    Raises
    ------
    InvalidInput
        No such file, other joints, times that do not increase, NaN, an interpolation that the points have no data for, or
        degrees without ``unit=``.
    MissingDependency
        YAML without PyYAML.
    """
    suffix = check_suffix(file, READ_SUFFIXES)
    check_kind(robot, "robot", Robot)
    names = Form("", export.find_columns(robot, joint_names)).names
    if saved := read_saved(file):
        _check_arm(*saved, robot, names, file, unit)
        if saved[1] and all(x is None for x in (interpolation, start, ignore, unwrap, columns)):
            return saved[0].trajectory
    return _load(file, suffix, robot, names, (columns, ignore, () if saved else unit), (interpolation, start, unwrap))


def _load(
    file: str | os.PathLike[str], suffix: str, robot: Robot, names: list[str],
    reading: tuple[Names, Names, Names], following: tuple[str | None, ArrayLike | None, Names],
) -> Trajectory:  # fmt: skip
    """Return the trajectory through the setpoints of a table or a message, with its notes."""
    columns, ignore, unit = reading
    try:
        if suffix == ".csv":
            points = _convert(read_log(read_table(file, columns, ignore), robot, names), robot, unit)
            if points.assumed and unit != ():
                assumed, like = ", ".join(points.assumed), _name_others(points.assumed)
                points.notes.append(f"no units in the header: read in {assumed}; unit={like} states others")
        else:
            message = _find_message(export.from_text(decode_text(read_bytes(FilePath(file))), suffix))
            points = _convert(export.read_points(message, names, read_names(ignore, "ignore")), robot, unit)
        trajectory = _build(points, robot, *following)
        if robot.motors is not None:
            trajectory = map_joints(trajectory, robot.motors.matrix, robot.motors.offset)
            words = f"the positions are those of the motors {', '.join(names)}, with the matrix of {robot.name}"
            points.notes.extend([words] * (unit != ()))
    except InvalidInput as error:
        clear = error.argument in ("interpolation", "start", "ignore", "unwrap", "unit") or str(file) in error.argument
        raise (error if clear else locate_error(file, error)) from None
    trajectory.notes = warn_of_assumptions(file, points.notes, stacklevel=4)
    return trajectory


def read_saved(file: str | os.PathLike[str]) -> tuple[Motion, bool] | None:
    """Return the motion of a file that `save` wrote, and whether it is exact, not points at a rate; None for other files.

    Joints rounded to 16 digits give a piece of 1 ms a jerk that is off by 1e-5 rad/s³: the polynomials of the file are exact.
    """
    content, suffix = read_bytes(FilePath(file)), FilePath(file).suffix.lower()
    if suffix == ".csv":
        return (load_motion(file), b"\n# rate: " not in content) if content.startswith(b"# format") else None
    data = parse_json(decode_text(content, str(file)), str(file)) if suffix == ".json" else None
    found = data.get("format") if isinstance(data, dict) else None
    if isinstance(found, str) and found.startswith("optik-") and found != CONTENT:
        advice = f"optik view {file} shows an execution or a failed plan"
        expected = "setpoints, a message, or a saved motion"
        raise InvalidInput(f"{file}: format", repr(found)[:60], expected, advice=advice)
    return (load_motion(file), True) if found == CONTENT else None


def _check_arm(saved: Motion, exact: bool, robot: Robot, names: list[str], file: Any, unit: Names) -> None:
    """Raise InvalidInput for a saved motion of other joints or motors, or exact polynomials in another order, or a unit."""
    own = [*maker_names(saved.robot)]
    if unit is not None:
        raise InvalidInput("unit", repr(unit)[:60], f"no unit=, because {file} states its units")
    if not have_same_matrix(saved.robot.motors, robot.motors):
        raise InvalidInput(f"{file}: motors", "motors with other names, matrix or offsets", f"those of {robot.name}")
    if {*own} != {*names} or (exact and own != names):
        raise InvalidInput(f"{file}: joint_names", ", ".join(own), f"those of {robot.name}, {', '.join(names)}")


def _find_message(data: Any) -> Any:
    """Return the only JointTrajectory at any depth of a message: the mapping that has points, or columns of positions."""
    found = [one for one in find_mappings(data) if one.get("points") or ("joint_names" in one and one.get("positions"))]
    if not found and any("joint_limits" in one for one in find_mappings(data)):
        raise InvalidInput("content", "joint_limits", "a trajectory", advice="load_limits reads this file")
    if len(found) > 1:
        raise InvalidInput("trajectory", f"{len(found)} trajectories", "one mapping with joint_names and points")
    return found[0] if found else data


def _convert(points: MessagePoints, robot: Robot, unit: Names) -> MessagePoints:
    """Return setpoints in SI units, with the units of ``unit=`` where the file states none."""
    bases, stated = {one: next(iter(sizes)) for sizes in UNIT_SIZES for one in sizes}, read_names(unit, "unit")
    others = [bare for one in stated if (bare := "".join(split_unit(one))) not in points.stated]
    units, assumed = {bases.get(one, ""): one for one in others}, {one: one.partition("/")[0] for one in points.assumed}
    if len(units) < len(others) or not {*units} <= {*assumed.values()}:
        expected = "no unit=, because the file states all units"
        if assumed:
            known = f", or {', '.join(points.stated)}, which it states" * bool(points.stated)
            which = f"units for {', '.join(dict.fromkeys(assumed.values()))}, which the file does not state"
            expected = f"{which}, such as {_name_others(assumed)}{known}"
        raise InvalidInput("unit", ",".join(stated)[:60], expected)
    if "s" in assumed and "s" not in units and points.begin >= ROS_TIME and not (points.t % 1.0).any():
        units["s"] = "ns"
        points.notes.append("the times are in nanoseconds, because they are large whole numbers")
    sizes = {one: find_size(units.get(base, ""), base) or 1.0 for one, base in assumed.items()}
    values = [rows * [sizes.get(one, 1.0) for one in list_units(robot, k)] for k, rows in enumerate(points.values)]
    size, left = sizes.get("s", 1.0), [one for one, base in assumed.items() if base not in units]
    points = points._replace(t=points.t * size, begin=points.begin * size, values=values, assumed=left)
    if unit != ():
        _check_meant(points, robot)
    return points


def _name_others(assumed: Iterable[str]) -> str:
    """Return an example of ``unit=`` for assumed units."""
    return repr(",".join(dict.fromkeys(OTHER_UNITS[one.partition("/")[0]] for one in assumed)))


def _check_meant(points: MessagePoints, robot: Robot) -> None:
    """Raise InvalidInput for times and positions without units that are implausible in seconds and radians."""
    far = (np.abs(points.t + points.begin) > LATEST) | (np.diff(points.t, prepend=0.0) > LONGEST_STEP)
    for i in np.flatnonzero(far & ("s" in points.assumed)).tolist()[:1]:
        expected = f"times within {LATEST:g} s, and steps of at most {LONGEST_STEP:g} s"
        advice = "unit='ms', 'us' or 'ns' gives another unit"
        raise InvalidInput(points.locate(i), f"{points.t[i] + points.begin:.6g} s", expected, advice=advice)
    q, turns, limits = points.values[0], ~robot.prismatic, maker_limits(robot)
    if "rad" in points.assumed and (asked := ask_for_degrees(limits, turns, q)):
        low, high = limits.lower, limits.upper
        row, j = np.unravel_index(np.argmax(np.where(turns, np.maximum(low - q, q - high), 0.0)), q.shape)
        got, expected = f"{maker_names(robot)[j]} = {q[row, j]:.6g}", f"its range [{low[j]:.6g}, {high[j]:.6g}] [rad]"
        advice = f"{asked} unit='deg' reads degrees, unit='rad' radians"
        raise InvalidInput(points.locate(int(row), int(j)), got, expected, advice=advice)


def _build(
    points: MessagePoints, robot: Robot, interpolation: str | None, start: ArrayLike | None, unwrap: Names
) -> Trajectory:
    """Return the trajectory through setpoints."""
    t, values, first = points.t, points.values, 0
    for i in np.flatnonzero(~(np.diff(t) > 0.0))[:1]:
        got = f"{t[i + 1] + points.begin:.9g} s after {t[i] + points.begin:.9g} s"
        raise InvalidInput(points.locate(i + 1), got, "times that increase")
    if start is not None:
        q = maker_joints(robot, robot.configuration(start, "start"))
        if not points.begin > 0.0:
            got = f"a configuration, and a first point at {points.begin:.9g} s"
            raise InvalidInput("start", got, "none, or a first point after 0 s")
        t, first = np.append(0.0, t + points.begin), 1
        values = [np.vstack([np.zeros(robot.n) if k else q, rows]) for k, rows in enumerate(values)]
        points.notes.append("the arm is at rest at the start")
    elif points.begin and points.from_start:
        advice = "start=Q is the configuration at 0 s"
        raise InvalidInput(points.locate(0), f"{points.begin:.9g} s", "a first point at 0 s", advice=advice)
    elif points.begin:
        points.notes.append(f"the motion starts at the first time, {points.begin:.15g} s")
    if t.size < 2:
        expected = "at least two points; or one point after 0 s and start=Q, the configuration at 0 s"
        raise InvalidInput(points.locate(0), "one point", expected)
    values[0] = _remove_turns(t, values[0], robot, unwrap, lambda i, j: points.locate(i - first, j))
    if interpolation == SPLINE:  # through the points; the controller reaches the first one from the start
        spline = scipy.interpolate.CubicSpline(t[first:], values[0][first:], bc_type="clamped")
        return trajectory_through(t, values[0], np.vstack([np.zeros((first, robot.n)), spline(t[first:], 1)]))
    known = (*INTERPOLATIONS[: len(values)], SPLINE)
    if interpolation is not None and interpolation not in known:
        got = f"{interpolation!r:.60} for {', '.join(export.POINT_FIELDS[: len(values)])}"
        raise InvalidInput("interpolation", got, f"one of {', '.join(known)}")
    return trajectory_through(t, *values[: len(values) if interpolation is None else known.index(interpolation) + 1])


def _remove_turns(t: Array, q: Array, robot: Robot, unwrap: Names, place: Callable[[int, int], str]) -> Array:
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
        raise InvalidInput(place(i + 1, j), got, "continuous positions of a joint without limits", advice=advice)
    return wrapped
