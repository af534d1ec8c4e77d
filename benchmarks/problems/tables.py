"""Files of poses, CSV and NPZ: read and checked, with messages that name file, row and column."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik import se3
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.file_io import check_suffix, read_bytes
from optik.tables import read_table, warn_of_assumptions
from optik.types import Array

POSITION = ("x_m", "y_m", "z_m")
"""Columns of a position [m]."""

QUATERNION = ("qw", "qx", "qy", "qz")
"""Columns of a unit quaternion [1], its scalar part first."""

ROTATION = tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
"""Columns of a rotation matrix [1], row by row."""

UNIT_ERROR = 1e-3
"""Largest |‖quaternion‖ − 1|, and largest error of R Rᵀ, of numbers that were rounded when they were written [1]."""


class Poses(NamedTuple):
    """Content of a file: poses (k, 4, 4) [1, m], starts (k, n) inside the limits [rad, m], and the group of each pose."""

    targets: Array
    starts: Array | None
    group: NDArray[np.str_]


def read_poses(path: Path, robot: Robot | None = None) -> Poses:
    """Read poses and optional starts from a CSV or NPZ file."""
    return (_from_csv if check_suffix(path, (".csv", ".npz")) == ".csv" else _from_npz)(path, robot)


# ---------------------------------------------------------------- CSV


def _from_csv(path: Path, robot: Robot | None) -> Poses:
    """Return the poses of a CSV file."""
    table = read_table(path)
    warn_of_assumptions(path, table.notes)
    columns, where = list(table.columns), [table.locate(row) for row in range(len(table.lines))]
    if not where:
        raise InvalidInput(str(path), "no rows", f"a header such as {','.join((*POSITION, *QUATERNION))} and rows")
    joints = _joint_columns(robot) if robot is not None else []
    turned = QUATERNION if "qw" in columns else ROTATION
    known = [*POSITION, *turned, *joints, "group"]
    _check_columns(path, columns, known, [*POSITION, *turned])
    targets = np.tile(np.eye(4), (len(where), 1, 1))
    targets[:, :3, 3] = table.read_numbers(POSITION)
    values = table.read_numbers(turned)
    targets[:, :3, :3] = of_quaternions(values, where) if turned is QUATERNION else values.reshape(-1, 3, 3)
    starts = None
    if present := [name for name in joints if name in columns]:
        _check_columns(path, columns, known, joints)
        starts = table.read_numbers(present)
    group = [table.read_cells(row, ["group"])[0] if "group" in columns else path.stem for row in range(len(where))]
    return _checked(where, targets, starts, np.array(group), robot)


def _joint_columns(robot: Robot) -> list[str]:
    """Return the names of the columns of a start, with their units."""
    return [f"q{i}_{'m' if slides else 'rad'}" for i, slides in enumerate(robot.prismatic, start=1)]


def _check_columns(path: Path, columns: list[str], known: Sequence[str], need: Sequence[str]) -> None:
    """Raise InvalidInput for an unknown or missing column."""
    for name in columns:
        if name not in known:
            raise InvalidInput(f"{path}, header", f"the column {name!r}", f"columns among {', '.join(known)}")
    for name in need:
        if name not in columns:
            other = " (or qw, qx, qy, qz in place of r11 to r33)" if name in ROTATION else ""
            raise InvalidInput(f"{path}, header", f"no column {name!r}", f"the columns {', '.join(need)}{other}")


def of_quaternions(values: Array, where: Sequence[str]) -> Array:
    """Return the rotation matrices (k, 3, 3) of quaternions (k, 4), scalar part first."""
    from scipy.spatial.transform import Rotation

    size = np.linalg.norm(values, axis=1)
    if (wrong := np.abs(size - 1.0) > UNIT_ERROR).any():
        i = int(wrong.argmax())
        raise InvalidInput(f"{where[i]}, columns qw to qz", f"a quaternion of length {size[i]:.6g}", "length 1")
    return np.asarray(Rotation.from_quat(values, scalar_first=True).as_matrix())


# ---------------------------------------------------------------- NPZ, and both


def _from_npz(path: Path, robot: Robot | None) -> Poses:
    """Return the poses of an NPZ file."""
    content = read_bytes(path, argument="path")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
    except (ValueError, OSError, zipfile.BadZipFile, EOFError) as error:
        raise InvalidInput(str(path), str(error)[:120], "an NPZ file of numbers and text") from None
    unknown = sorted(set(found) - {"targets", "starts", "group"})
    if unknown or "targets" not in found:
        came = f"the array {unknown[0]!r}" if unknown else "no array 'targets'"
        raise InvalidInput(str(path), came, "targets (k, 4, 4), and optionally starts (k, n) and group (k,)")
    targets = _numbers(path, "targets", found["targets"], (-1, 4, 4))
    k = len(targets)
    n = robot.n if robot is not None else 0
    starts = _numbers(path, "starts", found["starts"], (k, n)) if "starts" in found else None
    group = found.get("group", np.full(k, path.stem))
    if group.shape != (k,) or group.dtype.kind != "U":
        raise InvalidInput(f"{path}, group", f"{group.dtype} of shape {group.shape}", f"text of shape ({k},)")
    return _checked([f"{path}, targets[{i}]" for i in range(k)], targets, starts, group, robot)


def _numbers(path: Path, name: str, array: Array, shape: tuple[int, ...]) -> Array:
    """Check the shape (−1 for any length above 0) and the values of an array."""
    fits = array.ndim == len(shape) and all(want in (-1, have) for want, have in zip(shape, array.shape, strict=True))
    if not fits or not array.size or array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        came = (
            f"{array.dtype} of shape {array.shape}"
            if not fits or not array.size
            else "a value that is not a finite number"
        )
        raise InvalidInput(f"{path}, {name}", came, f"finite numbers of shape {str(shape).replace('-1', 'k')}")
    return np.array(array, dtype=float)


def _checked(
    where: Sequence[str], targets: Array, starts: Array | None, group: NDArray[np.str_], robot: Robot | None
) -> Poses:
    """Raise InvalidInput for invalid poses and for starts outside the limits; orthonormalise rounded rotations."""
    R = targets[:, :3, :3]
    error = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2))
    wrong = (error > UNIT_ERROR) | (np.linalg.det(R) < 0.0) | (targets[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1)
    if wrong.any():
        i = int(wrong.argmax())
        raise InvalidInput(where[i], "a matrix that is not a pose", "an orthonormal rotation with determinant 1")
    exact = np.stack([se3.nearest_pose(T) for T in targets])
    if starts is not None and robot is not None:
        outside = ~robot.limits.contains(starts)
        if outside.any():
            i = int(outside.argmax())
            raise InvalidInput(
                where[i], "a start outside the joint limits", f"joint values of {robot.name} [rad, m] within its limits"
            )
    return Poses(exact, starts, group)
