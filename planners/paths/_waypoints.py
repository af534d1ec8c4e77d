"""Waypoints of a tool from a table of comma-separated values, as written by CAM systems and scanners."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.check import real_array
from optik.errors import InvalidInput
from optik.file_io import CsvTable, read_csv
from optik.types import Array

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


def read_waypoints(file: str | os.PathLike[str], orientation: ArrayLike | None) -> Array:
    """Return the poses (k, 4, 4) of a file; see `Polyline.from_csv`."""
    if not isinstance(file, str | os.PathLike):
        raise InvalidInput("file", repr(file)[:60], "the path of a CSV file")
    table = _table(Path(file))
    columns, numbers = table.columns, table.numbers(table.columns)
    position = next(names for names in POSITION_COLUMNS if set(names) <= set(columns))
    turned = next((names for names in ORIENTATION_COLUMNS if set(names) <= set(columns)), ())
    if turned in ((), AXIS_COLUMNS) and orientation is None:
        what = "i,j,k, which leave the rotation about the axis free," if turned else "no columns of an orientation"
        raise InvalidInput("orientation", "None", f"a rotation (3, 3) of the tool, because the file has {what}")
    first = _rotation(np.eye(3) if orientation is None else orientation)
    p = POSITION_COLUMNS[position] * numbers[:, [columns.index(c) for c in position]]
    values = numbers[:, [columns.index(c) for c in turned]]
    return np.stack([se3.pose(R, x) for R, x in zip(_rotations(table.places, turned, values, first), p, strict=True)])


def _rotation(orientation: ArrayLike) -> Array:
    R = real_array(orientation, "orientation", "a rotation (3, 3)")
    if R.shape != (3, 3):
        raise InvalidInput("orientation", f"shape {R.shape}", "a rotation (3, 3)")
    return se3.nearest_pose(se3.check_pose(se3.pose(R), "orientation"))[:3, :3]


def _table(file: Path) -> CsvTable:
    """Return the numbers of a file under its column names in lower case."""
    table = read_csv(file)
    if not table.columns:
        raise InvalidInput(table.header, "no line", ACCEPTED_HEADER)
    table = table._replace(columns=_header(table.header, table.columns))
    if len(table.rows) < 2:
        raise InvalidInput(str(file), f"{len(table.rows)} rows of numbers", "at least two waypoints")
    return table


def _header(at: str, row: list[str]) -> list[str]:
    """Return the column names in lower case: one position, at most one orientation, and nothing else."""
    columns = [name.strip().lower() for name in row]
    positions = [names for names in POSITION_COLUMNS if set(names) <= set(columns)]
    turned = [names for names in ORIENTATION_COLUMNS if set(names) <= set(columns)]
    known = {name for names in positions + turned for name in names}
    wrong = [repr(name.strip()) for name, column in zip(row, columns, strict=True) if column not in known]
    if len(positions) != 1 or len(turned) > 1 or wrong or len(columns) != len(set(columns)):
        came = f"{', '.join(wrong)} in " if wrong and positions else ""
        raise InvalidInput(at, f"{came}{','.join(row)!r}"[:160], ACCEPTED_HEADER)
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
