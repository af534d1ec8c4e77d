"""Waypoints of a tool or of the joints from a table, as CAM systems, scanners and robots write them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.plain import make_rotation
from optik.arm.reach import FARTHEST_REACH, reach_bound
from optik.arm.robot import Robot
from optik.check import real_array
from optik.errors import InvalidInput
from optik.tables import UNIT_SIZES, TextTable
from optik.task import POSE
from optik.types import Array, Flags

POSITION_COLUMNS = ("x", "y", "z")
"""Columns of the position."""
QUATERNION_COLUMNS, ANGLE_COLUMNS = ("qx", "qy", "qz", "qw"), ("roll", "pitch", "yaw")
ROTATION_COLUMNS, KUKA_COLUMNS = ("rx", "ry", "rz"), ("a", "b", "c")
AXIS_COLUMNS = (("i", "j", "k"), ("nx", "ny", "nz"))
ORIENTATION_COLUMNS = (QUATERNION_COLUMNS, ANGLE_COLUMNS, *AXIS_COLUMNS, ROTATION_COLUMNS, KUKA_COLUMNS)
"""Columns of an orientation: a quaternion; roll, pitch, yaw; an axis; a rotation vector; KUKA's angles about z, y and x."""
ORIENTATION_UNITS: dict[tuple[str, ...], str] = {ANGLE_COLUMNS: "rad", ROTATION_COLUMNS: "rad", KUKA_COLUMNS: "deg"}
"""Units of the columns of an orientation where the header has none."""
ASSUMED = {ROTATION_COLUMNS: "rx,ry,rz are rotation vectors", KUKA_COLUMNS: "A,B,C are KUKA's angles about z, y and x"}
"""Assumptions about columns whose meaning differs between programs."""
ROTATION_KINDS = {QUATERNION_COLUMNS: "quaternion_xyzw", ANGLE_COLUMNS: "rpy_deg", ROTATION_COLUMNS: "rotation_vector_rad",
                  KUKA_COLUMNS: "abc_deg"}  # fmt: skip
"""Keys of these orientations in files of poses."""
SHORTEST_AXIS = 1e-9
"""Shortest axis [1]."""
FARTHEST_POINT = 100.0
"""Farthest point [m] for an unknown arm: larger coordinates are probably in millimetres."""
LEAST_VIA_TOLERANCE = 1e-6
"""Least tolerance of a via point [m, rad]: below it, rounding decides whether the point is met."""
ACCEPTED_HEADER = "a header with x,y,z [m] or x_mm,y_mm,z_mm, and perhaps an orientation, such as qx,qy,qz,qw or A,B,C"
"""The allowed header lines, as an error states them."""
TOLERANCE_COLUMNS = ("tolerance_mm", "tolerance_deg")
"""Columns of the tolerance of via points."""


class JointWaypoint(NamedTuple):
    """A row of a table: a configuration (n,) or a pose (4, 4), and a tolerance [m, rad] or None."""

    target: Array
    tolerance: tuple[float, float] | None


def check_waypoints(waypoints: Any, argument: str = "waypoints") -> Array:
    """Return waypoints (k, 4, 4), at least two, with exact rotations."""
    if isinstance(waypoints, str | Mapping) or not isinstance(waypoints, Iterable):
        raise InvalidInput(argument, repr(waypoints)[:60], "poses (k, 4, 4)")
    checked = [se3.nearest_pose(se3.check_pose(T, f"{argument}[{i}]")) for i, T in enumerate(waypoints)]
    if len(checked) < 2:
        raise InvalidInput(argument, f"{len(checked)} poses", "at least two")
    return np.stack(checked)


def read_waypoints(table: TextTable, orientation: ArrayLike | None, robot: Robot | None, unit: str | None) -> Array:
    """Return the poses (k, 4, 4) of a table; see `Polyline.from_csv`."""
    table, turned = _resolve(table, {}, unit)
    table.refuse_others(POSITION_COLUMNS + turned, ACCEPTED_HEADER)
    if len(table.lines) < 2:
        raise InvalidInput(table.file, "fewer than two rows", "at least two waypoints")
    if (turned in AXIS_COLUMNS or not turned) and orientation is None:
        free = f"{','.join(turned)}, which leave the rotation about the axis free"
        what = f"the file has {free if turned else 'no columns of an orientation'}"
        raise InvalidInput("orientation", "None", f"a rotation (3, 3) of the tool, because {what}")
    return _read_poses(table, turned, check_rotation(np.eye(3) if orientation is None else orientation), robot)


def read_joint_waypoints(robot: Robot, table: TextTable, unit: str | None) -> list[JointWaypoint]:
    """Return the rows of a table, of which the first is a configuration; see `PointToPoint.from_csv`."""
    in_units = [f"q{i + 1}_{'mm' if slides else 'deg'}" for i, slides in enumerate(robot.prismatic)]
    accepted = (
        f"a header with {in_units[0]},…,{in_units[-1]} (or q1,… [rad, m]) for {robot.name}, and perhaps x_mm,y_mm,z_mm with an "
        f"orientation or {','.join(TOLERANCE_COLUMNS)}"
    )
    joints = {f"q{i + 1}": "m" if slides else "rad" for i, slides in enumerate(robot.prismatic)}
    table, turned = _resolve(table, joints | dict.fromkeys(TOLERANCE_COLUMNS, ""), unit, accepted)
    names, parts = table.columns, (POSITION_COLUMNS, TOLERANCE_COLUMNS)
    if not set(joints) <= set(names) or any(0 < len(set(part) & set(names)) < len(part) for part in parts):
        raise table.make_header_error(accepted)
    table.refuse_others([*joints, *turned, *POSITION_COLUMNS, *TOLERANCE_COLUMNS], accepted)
    others = [name for name in names if name in POSITION_COLUMNS + turned]
    if len(table.lines) < 2:
        raise InvalidInput(table.file, "fewer than two rows", "a start and a goal")
    tolerances = TOLERANCE_COLUMNS if TOLERANCE_COLUMNS[0] in names else ()
    at_joints, with_tolerance = _find_filled(table, joints), _find_filled(table, tolerances)
    at_poses = ~at_joints
    wrong = _find_filled(table, others) != at_poses
    ends = [i for i in (0, -1) if with_tolerance[i] or (i == 0 and at_poses[0])]
    if wrong.any() or ends:
        i = int(wrong.argmax()) if wrong.any() else ends[0]
        which = "start, a configuration without a tolerance" if i == 0 else "goal, without a tolerance"
        expected = "a configuration, or a pose and empty cells of the joints" if wrong.any() else f"the {which}"
        raise InvalidInput(table.locate(i), repr(table.separator.join(table.lines[i][1]))[:100], expected)
    rows = table.select_rows(np.flatnonzero(at_joints))
    q, (lower, upper) = rows.read_numbers(list(joints)), (robot.limits.lower, robot.limits.upper)
    for row, i in np.argwhere((q < lower - LIMIT_TOLERANCE) | (q > upper + LIMIT_TOLERANCE))[:1]:
        name, unit = list(joints)[i], list(joints.values())[i]
        advice = "" if names[name].unit or unit == "m" else f"{name} is in radians, {name}_deg in degrees"
        expected = f"a value in [{lower[i]:.6g}, {upper[i]:.6g}] {unit}, the range of {robot.joint_names[i]}"
        raise InvalidInput(rows.locate(row, name), f"{q[row, i]:.6g} {unit}", expected, advice=advice)
    rows = table.select_rows(np.flatnonzero(at_poses))
    targets = iter(q), iter(_read_poses(rows, turned, robot.fk(q[0])[:3, :3], robot) if rows.lines else ())
    chosen = table.select_rows(np.flatnonzero(with_tolerance))
    allowed = chosen.read_numbers(tolerances) * ([1e-3, np.pi / 180.0] if tolerances else 1.0)
    for row, i in np.argwhere(allowed < LEAST_VIA_TOLERANCE)[:1]:
        place, got = chosen.locate(row, tolerances[i]), chosen.read_cells(row, [tolerances[i]])[0]
        raise InvalidInput(place, got, f"a tolerance of at least {LEAST_VIA_TOLERANCE:g} m or rad, or an empty cell")
    tolerance, kinds = iter(allowed.tolist()), zip(at_poses.astype(int), with_tolerance, strict=True)
    return [JointWaypoint(next(targets[kind]), tuple(next(tolerance)) if has else None) for kind, has in kinds]


def _find_filled(table: TextTable, names: Iterable[str]) -> Flags:
    """Return the rows whose cells in these columns are filled; all of a row or none must be."""
    names, filled = list(names), []
    for row in range(len(table.lines)):
        cells = table.read_cells(row, names)
        if any(cells) and not all(cells):
            empty = names[cells.index("")]
            expected = f"numbers in all of {','.join(names)}, or in none"
            raise InvalidInput(table.locate(row, empty), "an empty cell", expected)
        filled.append(any(cells))
    return np.array(filled, dtype=np.bool_)


def _resolve(
    table: TextTable, others: Mapping[str, str], unit: str | None, accepted: str = ACCEPTED_HEADER
) -> tuple[TextTable, tuple[str, ...]]:
    """Return the table with the bare names of its columns, and the columns of its orientation; note assumptions."""
    if unit is not None and unit not in UNIT_SIZES[0]:
        raise InvalidInput("unit", repr(unit)[:60], f"the unit of x,y,z: {', '.join(UNIT_SIZES[0])}")
    units = {name: ORIENTATION_UNITS.get(names, "") for names in ORIENTATION_COLUMNS for name in names}
    kuka = set(KUKA_COLUMNS) <= set(table.resolve(units).columns)
    resolved = table.resolve({**others, **units, **dict.fromkeys(POSITION_COLUMNS, unit or ("mm" if kuka else "m"))})
    turned = [names for names in ORIENTATION_COLUMNS if set(names) <= set(resolved.columns)]
    if len(turned) > 1 or (not set(POSITION_COLUMNS) <= set(resolved.columns) and (turned or not others)):
        raise table.make_header_error(accepted)
    stated = {resolved.columns[name].unit for name in POSITION_COLUMNS if name in resolved.columns} - {""}
    if unit is not None and stated - {unit}:
        raise InvalidInput("unit", repr(unit), f"{', '.join(stated)}, the unit in {table.locate()}, or none")
    table.notes.extend(ASSUMED[names] for names in turned if names in ASSUMED)
    if kuka and unit is None and not stated:
        table.notes.append("X,Y,Z are in millimetres, because A,B,C are KUKA's")
    return resolved, turned[0] if turned else ()


def _read_poses(table: TextTable, turned: tuple[str, ...], first: Array, robot: Robot | None) -> Array:
    """Return the poses (k, 4, 4) of rows; a tool axis has the orientation nearest to the first one."""
    p, values = table.read_numbers(POSITION_COLUMNS), table.read_numbers(turned)
    far, most = np.linalg.norm(p, axis=1), FARTHEST_POINT
    if robot is not None:
        reach = reach_bound(robot, POSE)
        most = min(most, FARTHEST_REACH * float(reach[7] + np.linalg.norm(reach[:3]) + np.linalg.norm(reach[3:6])))
    for row in np.flatnonzero(far > most)[:1]:
        place, got = table.locate(row, *POSITION_COLUMNS), f"a coordinate of {np.abs(p[row]).max():.6g} m"
        advice = "" if table.columns["x"].unit else "unit='mm' reads x,y,z in millimetres"
        raise InvalidInput(place, got, f"points within {most:.3g} m of the base", advice=advice)
    return np.stack([se3.pose(R, x) for R, x in zip(_read_rotations(table, turned, values, first), p, strict=True)])


def check_rotation(orientation: ArrayLike | None, expected: str = "a rotation (3, 3)") -> Array:
    """Return a rotation (3, 3) of the tool, exact to rounding."""
    R = real_array(orientation, "orientation", expected, (3, 3))
    return se3.nearest_pose(se3.check_pose(se3.pose(R), "orientation"))[:3, :3]


def _read_rotations(table: TextTable, turned: tuple[str, ...], values: Array, first: Array) -> list[Array]:
    """Return the rotation of the tool (3, 3) for each row."""
    if not turned:
        return [first] * len(values)
    if turned in ROTATION_KINDS:
        kind = ROTATION_KINDS[turned]
        values = np.rad2deg(values) if kind.endswith("_deg") else values
        return [make_rotation(kind, row, table.locate(i, *turned)) for i, row in enumerate(values)]
    length = np.linalg.norm(values, axis=1)
    unit = np.abs(length - 1.0) <= se3.QUATERNION_ERROR
    for row in np.flatnonzero(~(length > SHORTEST_AXIS))[:1]:
        got = f"a vector of length {length[row]:.6g}"
        raise InvalidInput(table.locate(row, *turned), got, "an axis that is not 0")
    if not unit.all():
        table.notes.append(f"axes of lengths {length.min():.4g} to {length.max():.4g} are scaled to 1")
    rotations = [first]
    for row, axis in enumerate(values / length[:, None]):
        z = rotations[-1][:, 2]
        w, cosine = np.cross(z, -axis), float(-axis @ z)
        sine = float(np.linalg.norm(w))
        if cosine < 0.0 and sine < 1e-6:
            got = f"an axis opposite to {'the previous one' if row else 'orientation='}"
            raise InvalidInput(table.locate(row, *turned), got, "a turn of less than 180°")
        turn = w * (np.arctan2(sine, cosine) / sine) if sine > 0.0 else np.zeros(3)
        rotations.append(se3.exp_so3(turn) @ rotations[-1])
    return rotations[1:]
