"""Waypoints of a tool or of the joints from a table of comma-separated values, as written by CAM systems and scanners."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.model import unit_factors
from optik.arm.robot import Robot
from optik.check import real_array
from optik.errors import InvalidInput
from optik.file_io import CsvTable, read_csv
from optik.types import Array, Flags

POSITION_COLUMNS = {("x", "y", "z"): 1.0, ("x_mm", "y_mm", "z_mm"): 1e-3}
"""Columns of the position, and metres per unit."""
QUATERNION_COLUMNS, AXIS_COLUMNS = ("qx", "qy", "qz", "qw"), ("i", "j", "k")
ANGLE_COLUMNS = {("roll", "pitch", "yaw"): 180.0 / np.pi, ("roll_deg", "pitch_deg", "yaw_deg"): 1.0}
"""Columns of roll, pitch and yaw, and degrees per unit."""
ORIENTATION_COLUMNS = (QUATERNION_COLUMNS, *ANGLE_COLUMNS, AXIS_COLUMNS)
ACCEPTED_HEADER = (
    "a header line that names x,y,z [m] or x_mm,y_mm,z_mm, alone or with one of qx,qy,qz,qw; roll,pitch,yaw [rad]; "
    "roll_deg,pitch_deg,yaw_deg; i,j,k"
)
"""The allowed header lines, as an error states them."""
TOLERANCE_COLUMNS = ("tolerance_mm", "tolerance_deg")
"""Columns of the tolerance of via points."""


class JointWaypoint(NamedTuple):
    """A row of a table: a configuration (n,) or a pose (4, 4), and a tolerance [m, rad] or None."""

    target: Array
    tolerance: tuple[float, float] | None


def read_waypoints(file: str | os.PathLike[str], orientation: ArrayLike | None) -> Array:
    """Return the poses (k, 4, 4) of a file; see `Polyline.from_csv`."""
    table = _read(file)
    if not table.columns:
        raise InvalidInput(table.header, "no line", ACCEPTED_HEADER)
    table = table._replace(columns=_header(table.header, table.columns))
    if len(table.rows) < 2:
        raise InvalidInput(str(file), "fewer than two rows", "at least two waypoints")
    turned = next((names for names in ORIENTATION_COLUMNS if set(names) <= set(table.columns)), ())
    if turned in ((), AXIS_COLUMNS) and orientation is None:
        what = "i,j,k, which leave the rotation about the axis free," if turned else "no columns of an orientation"
        raise InvalidInput("orientation", "None", f"a rotation (3, 3) of the tool, because the file has {what}")
    return _poses(table, _rotation(np.eye(3) if orientation is None else orientation))


def read_joint_waypoints(robot: Robot, file: str | os.PathLike[str]) -> list[JointWaypoint]:
    """Return the rows of a file, of which the first is a configuration; see `PointToPoint.from_csv`."""
    table = _read(file)
    in_units = [f"q{i + 1}_{'mm' if slides else 'deg'}" for i, slides in enumerate(robot.prismatic)]
    accepted = (
        f"a header line that names {','.join(in_units)} (or q1,… [rad, m]) for {robot.name}, with x_mm,y_mm,z_mm and an "
        f"orientation for rows with poses, and {','.join(TOLERANCE_COLUMNS)} for tolerances"
    )
    columns = [name.lower() for name in table.columns]
    plain = [f"q{i + 1}" for i in range(robot.n)]
    joints, factors = (plain, np.ones(robot.n)) if plain[0] in columns else (in_units, unit_factors(robot))
    others = [c for c in columns if c not in joints and c not in TOLERANCE_COLUMNS]
    several = len(columns) != len(set(columns)) or 0 < len(set(TOLERANCE_COLUMNS) & set(columns)) < 2
    if not set(joints) <= set(columns) or several:
        raise InvalidInput(table.header, repr(",".join(table.columns))[:160] if columns else "no line", accepted)
    if others:
        _header(table.header, others, accepted)
    table = table._replace(columns=columns)
    if len(table.rows) < 2:
        raise InvalidInput(str(file), "fewer than two rows", "a start and a goal")
    tolerances = TOLERANCE_COLUMNS if TOLERANCE_COLUMNS[0] in columns else ()
    at_joints, with_tolerance = _filled(table, joints), _filled(table, tolerances)
    at_poses = ~at_joints
    wrong = _filled(table, others) != at_poses
    ends = [i for i in (0, -1) if with_tolerance[i] or (i == 0 and at_poses[0])]
    if wrong.any() or ends:
        i = int(wrong.argmax()) if wrong.any() else ends[0]
        which = "start, a configuration without a tolerance" if i == 0 else "goal, without a tolerance"
        expected = "a configuration, or a pose and empty cells of the joints" if wrong.any() else f"the {which}"
        raise InvalidInput(table.places[i], repr(",".join(table.rows[i]))[:100], expected)
    targets: list[Array] = list(np.zeros(len(table.rows)))
    q = _part(table, at_joints).numbers(joints) / factors
    for row, x in zip(np.flatnonzero(at_joints), q, strict=True):
        targets[row] = x
    if at_poses.any():
        poses = _poses(_part(table, at_poses), robot.fk(q[0])[:3, :3])
        for row, pose in zip(np.flatnonzero(at_poses), poses, strict=True):
            targets[row] = pose
    allowed = iter(_part(table, with_tolerance).numbers(tolerances) * [1e-3, np.pi / 180.0] if tolerances else ())
    return [
        JointWaypoint(target, (float((x := next(allowed))[0]), float(x[1])) if given else None)
        for target, given in zip(targets, with_tolerance, strict=True)
    ]


def _filled(table: CsvTable, names: Sequence[str]) -> Flags:
    """Return the rows whose cells in these columns are filled; all of a row or none must be."""
    cells = [[bool(row[table.columns.index(name)]) for name in names] for row in table.rows]
    for place, row in zip(table.places, cells, strict=True):
        if any(row) and not all(row):
            empty = names[row.index(False)]
            raise InvalidInput(
                f"{place}, column {empty}", "an empty cell", f"numbers in all of {','.join(names)}, or in none"
            )
    return np.array([any(row) for row in cells], dtype=np.bool_)


def _part(table: CsvTable, which: Flags) -> CsvTable:
    """Return some rows of a table."""
    chosen = np.flatnonzero(which)
    return table._replace(rows=[table.rows[i] for i in chosen], places=[table.places[i] for i in chosen])


def _poses(table: CsvTable, first: Array) -> Array:
    """Return the poses (k, 4, 4) of rows; a tool axis has the orientation nearest to the first one."""
    position = next(names for names in POSITION_COLUMNS if set(names) <= set(table.columns))
    turned = next((names for names in ORIENTATION_COLUMNS if set(names) <= set(table.columns)), ())
    p, values = POSITION_COLUMNS[position] * table.numbers(position), table.numbers(turned)
    return np.stack([se3.pose(R, x) for R, x in zip(_rotations(table.places, turned, values, first), p, strict=True)])


def _rotation(orientation: ArrayLike) -> Array:
    R = real_array(orientation, "orientation", "a rotation (3, 3)")
    if R.shape != (3, 3):
        raise InvalidInput("orientation", f"shape {R.shape}", "a rotation (3, 3)")
    return se3.nearest_pose(se3.check_pose(se3.pose(R), "orientation"))[:3, :3]


def _read(file: str | os.PathLike[str]) -> CsvTable:
    """Return the cells of a file."""
    if not isinstance(file, str | os.PathLike):
        raise InvalidInput("file", repr(file)[:60], "the path of a CSV file")
    return read_csv(Path(file))


def _header(at: str, row: list[str], accepted: str = ACCEPTED_HEADER) -> list[str]:
    """Return the column names in lower case: one position, at most one orientation, and nothing else."""
    columns = [name.strip().lower() for name in row]
    positions = [names for names in POSITION_COLUMNS if set(names) <= set(columns)]
    turned = [names for names in ORIENTATION_COLUMNS if set(names) <= set(columns)]
    known = {name for names in positions + turned for name in names}
    wrong = [repr(name.strip()) for name, column in zip(row, columns, strict=True) if column not in known]
    if len(positions) != 1 or len(turned) > 1 or wrong or len(columns) != len(set(columns)):
        came = f"{', '.join(wrong)} in " if wrong and positions else ""
        raise InvalidInput(at, f"{came}{','.join(row)!r}"[:160], accepted)
    return columns


def _rotations(places: list[str], turned: tuple[str, ...], values: Array, first: Array) -> list[Array]:
    """Return the rotation of the tool (3, 3) for each row."""
    if not turned:
        return [first] * len(places)
    if turned in ANGLE_COLUMNS:
        return [se3.from_xyz_rpy(np.zeros(3), ANGLE_COLUMNS[turned] * angles)[:3, :3] for angles in values]
    length = np.linalg.norm(values, axis=1)
    off = np.flatnonzero(~(np.abs(length - 1.0) <= se3.QUATERNION_ERROR))
    if off.size:
        at = f"{places[off[0]]}, columns {','.join(turned)}"
        raise InvalidInput(at, f"a vector of length {length[off[0]]:.6g}", "a vector of length 1")
    values = values / length[:, None]
    if turned == QUATERNION_COLUMNS:
        return [se3.from_quaternion(xyzw[[3, 0, 1, 2]]) for xyzw in values]
    rotations = [first]
    for place, axis in zip(places, values, strict=True):
        z = rotations[-1][:, 2]
        w, cosine = np.cross(z, -axis), float(-axis @ z)
        sine = float(np.linalg.norm(w))
        if cosine < 0.0 and sine < 1e-6:
            raise InvalidInput(
                f"{place}, columns i,j,k", "an axis opposite to the previous one", "a turn of less than 180°"
            )
        turn = w * (np.arctan2(sine, cosine) / sine) if sine > 0.0 else np.zeros(3)
        rotations.append(se3.exp_so3(turn) @ rotations[-1])
    return rotations[1:]
