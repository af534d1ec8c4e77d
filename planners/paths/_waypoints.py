"""Waypoints of a tool from a table of comma-separated values, as written by CAM systems and scanners."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.check import real_array
from optik.errors import InvalidInput
from optik.file_io import decode_text, read_bytes
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
    name = os.fspath(file)
    columns, lines, numbers = _table(name, decode_text(read_bytes(Path(name))))
    position = next(names for names in POSITION_COLUMNS if set(names) <= set(columns))
    turned = next((names for names in ORIENTATION_COLUMNS if set(names) <= set(columns)), ())
    if turned in ((), AXIS_COLUMNS) and orientation is None:
        what = "i,j,k, which leave the rotation about the axis free," if turned else "no columns of an orientation"
        raise InvalidInput("orientation", "None", f"a rotation (3, 3) of the tool, because the file has {what}")
    first = _rotation(np.eye(3) if orientation is None else orientation)
    p = POSITION_COLUMNS[position] * numbers[:, [columns.index(c) for c in position]]
    values = numbers[:, [columns.index(c) for c in turned]]
    return np.stack([se3.pose(R, x) for R, x in zip(_rotations(name, lines, turned, values, first), p, strict=True)])


def _rotation(orientation: ArrayLike) -> Array:
    R = real_array(orientation, "orientation", "a rotation (3, 3)")
    if R.shape != (3, 3):
        raise InvalidInput("orientation", f"shape {R.shape}", "a rotation (3, 3)")
    return se3.nearest_pose(se3.check_pose(se3.pose(R), "orientation"))[:3, :3]


def _table(name: str, text: str) -> tuple[list[str], list[int], Array]:
    """Return the column names, the line of each row and its numbers; skip empty lines and lines that begin with #."""
    rows = csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""), skipinitialspace=True)
    columns: list[str] = []
    lines: list[int] = []
    numbers: list[list[float]] = []
    try:
        for row in rows:
            if not any(map(str.strip, row)) or row[0].startswith("#"):
                continue
            if not columns:
                columns = _header(f"{name}, line {rows.line_num}", row)
                continue
            at = f"{name}, line {rows.line_num}"
            if len(row) != len(columns):
                raise InvalidInput(at, f"{len(row)} values", f"{len(columns)}, one for each column of the header")
            lines.append(rows.line_num)
            numbers.append([_number(f"{at}, column {c}", value) for c, value in zip(columns, row, strict=True)])
    except csv.Error as error:
        raise InvalidInput(f"{name}, line {rows.line_num}", str(error), "comma-separated values") from None
    if not columns:
        raise InvalidInput(name, "no line", ACCEPTED_HEADER)
    if len(numbers) < 2:
        raise InvalidInput(name, f"{len(numbers)} rows of numbers", "at least two waypoints")
    return columns, lines, np.array(numbers)


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


def _number(at: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise InvalidInput(at, repr(value)[:40], "a finite number")
    return number


def _rotations(name: str, lines: list[int], turned: tuple[str, ...], values: Array, first: Array) -> list[Array]:
    """Return the rotation of the tool (3, 3) for each row."""
    if not turned:
        return [first] * len(lines)
    if turned in ANGLE_COLUMNS:
        return [se3.from_xyz_rpy(np.zeros(3), ANGLE_COLUMNS[turned] * angles)[:3, :3] for angles in values]
    length = np.linalg.norm(values, axis=1)
    off = np.flatnonzero(~(np.abs(length - 1.0) <= se3.QUATERNION_ERROR))
    if off.size:
        at = f"{name}, line {lines[off[0]]}, columns {','.join(turned)}"
        raise InvalidInput(at, f"a vector of length {length[off[0]]:.6g}", "a vector of length 1")
    values = values / length[:, None]
    if turned == QUATERNION_COLUMNS:
        return [se3.from_quaternion(xyzw[[3, 0, 1, 2]]) for xyzw in values]
    rotations = [first]
    for line, axis in zip(lines, values, strict=True):
        z = rotations[-1][:, 2]
        w, cosine = np.cross(z, -axis), float(-axis @ z)
        sine = float(np.linalg.norm(w))
        if cosine < 0.0 and sine < 1e-6:
            at = f"{name}, line {line}, columns i,j,k"
            raise InvalidInput(at, "an axis opposite to the previous one", "a turn of less than 180°")
        turn = w * (np.arctan2(sine, cosine) / sine) if sine > 0.0 else np.zeros(3)
        rotations.append(se3.exp_so3(turn) @ rotations[-1])
    return rotations[1:]
