"""Motions in files, NPZ, JSON or CSV: arm, path and limits inside, read back to the last bit and certified again."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import zipfile
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from optik.arm.plain import numbers, record, word, words
from optik.arm.robot import Robot
from optik.errors import InvalidInput, OptikError
from optik.files import write_whole
from optik.types import Array
from planners.files._reading import content_of, parsed, suffix_of, text_of
from planners.limits import MotionLimits
from planners.motion import Motion, motion_of
from planners.paths import path_of
from planners.trajectory import Trajectory

if TYPE_CHECKING:
    from planners.plan import Plan

FORMAT = "optik-motion/1"
HEADER = ("format", "robot", "path", "limits", "law", "keeps", "tolerance")
OPTIONAL = ("span", "speed")
"""Keys that stand in a file only where the motion has them."""
UNPACKED = 2**29
"""Most bytes of the arrays of an NPZ file: ten times a motion through the most points that are sent, of 7 joints. A zip of
some megabytes can hold gigabytes of nothing."""


class Parts(NamedTuple):
    """What every format holds: the header as plain data, knots (m + 1,) and coefficients (d, m, n), highest power first."""

    header: dict[str, Any]
    knots: Array
    coefficients: Array


def save(motion: Motion | Plan, file: str | os.PathLike[str]) -> None:
    """Write a motion, whole or not at all; the file's suffix is its format.

    All three hold the arm, the path, the limits, the law's name and promises, and the exact polynomials.

    Parameters
    ----------
    motion : Motion or Plan
        What is written.
    file : str or path
        ``.npz``: arrays ``knots`` and ``coefficients``, the rest as JSON in ``header``. ``.json``: one key a line.
        ``.csv``: the same lines as comments, then a table of t, q, q̇, q̈ at the knots.

    Raises
    ------
    InvalidInput
        Another suffix.
    NoSolution
        A plan that failed.
    OutputError
        The file cannot be written.
    """
    write, _ = _format(file)
    content = write(motion_of(motion))
    write_whole(file, lambda part: part.write_bytes(content))


def load_motion(file: str | os.PathLike[str]) -> Motion:
    """Read a motion that `save` wrote, equal to the last bit; `Motion.certify` finds the same certificate.

    Raises
    ------
    InvalidInput
        No such file, another suffix or format, or damage: what is wrong is named. No code is ever run from a file.
    """
    _, read = _format(file)
    try:
        motion: Motion = read(content_of(FilePath(file)))
        return motion
    except InvalidInput as error:
        raise InvalidInput(f"{file}: {error.argument}", error.got, error.expected) from None
    except OptikError as error:
        raise InvalidInput(str(file), str(error), "a whole motion") from None


# ---------------------------------------------------------------- what a file holds


def _parts(motion: Motion) -> Parts:
    header: dict[str, Any] = {
        "format": FORMAT,
        "robot": motion.robot.to_dict(),
        "path": motion.path.to_dict(),
        "limits": motion.limits.to_plain(),
        "law": motion.law,
        "keeps": list(motion.keeps),
        "tolerance": None if motion.tolerance is None else list(motion.tolerance),
    }
    if motion.span is not None:
        header["span"] = list(motion.span)
    if motion.speed is not None:
        header["speed"] = motion.speed
    return Parts(header, motion.trajectory.knots, motion.trajectory.coefficients)


def _motion(parts: Parts) -> Motion:
    header = parts.header
    robot = Robot.from_dict(header["robot"])
    return Motion(
        robot,
        path_of(header["path"], robot),
        MotionLimits.from_plain(header["limits"], robot.n),
        _trajectory(parts.knots, parts.coefficients, robot.n),
        word(header["law"], "law"),
        words(header["keeps"], "keeps"),
        None if header["tolerance"] is None else _pair(header["tolerance"], "tolerance"),
        None if header.get("span") is None else _pair(header["span"], "span"),
        None if header.get("speed") is None else float(numbers(header["speed"], (), "speed")),
    )


def _pair(value: Any, argument: str) -> tuple[float, float]:
    first, second = numbers(value, (2,), argument).tolist()
    return first, second


def _trajectory(knots: Array, coefficients: Array, n: int) -> Trajectory:
    if knots.ndim != 1 or knots.size < 2:
        raise InvalidInput("knots", f"shape {knots.shape}", "at least two times")
    if not np.isfinite(knots).all() or knots[0] != 0.0 or not (np.diff(knots) > 0.0).all():
        wrong = int(np.argmin(np.append(knots[0] == 0.0, np.diff(knots) > 0.0)))
        raise InvalidInput("knots", f"knot {wrong} at {knots[wrong]:.9g} s", "finite times that increase from 0")
    wanted = (knots.size - 1, n)
    if coefficients.ndim != 3 or not 1 <= len(coefficients) <= 6 or coefficients.shape[1:] != wanted:
        raise InvalidInput("coefficients", f"shape {coefficients.shape}", f"shape (1 to 6, {wanted[0]}, {wanted[1]})")
    if not np.isfinite(coefficients).all():
        power, piece, joint = np.argwhere(~np.isfinite(coefficients))[0]
        raise InvalidInput("coefficients", f"{coefficients[power, piece, joint]} in piece {piece}", "finite numbers")
    return Trajectory(PPoly(coefficients, knots))


def _digest(parts: Parts) -> str:
    """SHA-256 of all that a file holds: a changed digit would still be a motion, but not the one that was written."""
    digest = hashlib.sha256(json.dumps(parts.header, sort_keys=True).encode())
    for array in (parts.knots, parts.coefficients):
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()


def _checked(parts: Parts, digest: Any) -> Parts:
    """Return the parts where they have the digest that the file states, if it does."""
    if digest is not None and digest != _digest(parts):
        raise InvalidInput("sha256", "content that is not what was written", "a file that nobody changed")
    return parts


def _header(data: dict[str, Any]) -> dict[str, Any]:
    found = data.get("format")
    if found != FORMAT:
        raise InvalidInput("format", repr(found)[:60], repr(FORMAT))
    return record(data, (*HEADER, *(key for key in OPTIONAL if key in data)), "header")


# ---------------------------------------------------------------- JSON


def _lines(parts: Parts) -> dict[str, str]:
    data = parts.header | {"knots": parts.knots.tolist(), "coefficients": parts.coefficients.tolist()}
    return {k: json.dumps(v, allow_nan=False) for k, v in (data | {"sha256": _digest(parts)}).items()}


def _to_json(motion: Motion) -> bytes:
    return ("{\n" + ",\n".join(f'"{k}": {v}' for k, v in _lines(_parts(motion)).items()) + "\n}\n").encode()


def _from_json(content: bytes) -> Motion:
    data = parsed(text_of(content), "content")
    if not isinstance(data, dict):
        raise InvalidInput("content", repr(data)[:60], f"a mapping with {', '.join(HEADER)}")
    return _motion(_from_lines(data))


def _from_lines(data: dict[str, Any]) -> Parts:
    inside = {k: v for k, v in data.items() if k not in ("knots", "coefficients", "sha256")}
    header = _header(inside)
    for key in ("knots", "coefficients"):
        if not isinstance(data.get(key), list):
            raise InvalidInput(key, repr(data.get(key))[:60], "a list")
    knots, powers = data["knots"], data["coefficients"]
    pieces = powers[0] if powers and isinstance(powers[0], list) else []
    joints = pieces[0] if pieces and isinstance(pieces[0], list) else []
    shape = (len(powers), len(pieces), len(joints))
    parts = Parts(header, numbers(knots, (len(knots),), "knots"), numbers(powers, shape, "coefficients"))
    return _checked(parts, data.get("sha256"))


# ---------------------------------------------------------------- CSV


def _to_csv(motion: Motion) -> bytes:
    columns, rows = _table(motion)
    out = io.StringIO()
    for key, line in _lines(_parts(motion)).items():
        out.write(f"# {key}: {line}\n")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(columns)
    table.writerows(rows.tolist())
    return out.getvalue().encode(errors="surrogatepass")


def _from_csv(content: bytes) -> Motion:
    lines = text_of(content).split("\n")
    count = next((i for i, line in enumerate(lines) if not line.startswith("# ")), len(lines))
    data = {}
    for line in lines[:count]:
        key, colon, value = line[2:].partition(": ")
        if not colon:
            raise InvalidInput("header", repr(line[:60]), "comment lines '# KEY: JSON'")
        data[key] = parsed(value, key)
    motion = _motion(_from_lines(data))
    try:
        rows = [row for row in csv.reader(io.StringIO("\n".join(lines[count:]), newline="")) if row]
    except csv.Error as error:
        raise InvalidInput("table", str(error), "comma-separated values") from None
    _check_table(rows, motion)
    return motion


def _table(motion: Motion) -> tuple[list[str], Array]:
    """Names of the columns, and rows (m + 1, 1 + 3n) of t, q, q̇, q̈ at the knots."""
    t = motion.trajectory.knots
    columns = ["t", *(f"{kind}_{name}" for kind in ("q", "dq", "ddq") for name in motion.robot.joint_names)]
    return columns, np.hstack([t[:, None], *(motion.trajectory(t, order) for order in range(3))])


def _check_table(rows: list[list[str]], motion: Motion) -> None:
    """Refuse a table that does not show the polynomials of the header, which are the motion."""
    columns, expected = _table(motion)
    if not rows or rows[0] != columns:
        raise InvalidInput("table", repr(rows[0] if rows else [])[:80], f"the columns {', '.join(columns)}"[:200])
    if len(rows) != len(expected) + 1:
        raise InvalidInput("table", f"{len(rows) - 1} rows", f"{len(expected)}, one a knot")
    scale = 1e-9 * np.maximum(np.abs(expected).max(axis=0), 1e-9)
    for i, (row, wanted) in enumerate(zip(rows[1:], expected, strict=True)):
        try:
            with np.errstate(invalid="ignore", over="ignore"):
                off = np.abs(np.array([float(x) for x in row]) - wanted) / scale
        except ValueError:  # no number, or another count of them
            raise InvalidInput(f"table, row {i}", repr(row)[:80], f"{len(columns)} numbers") from None
        if not (off <= 1.0).all():
            k = int(np.argmax(~(off <= 1.0)))
            raise InvalidInput(
                f"table, row {i}, {columns[k]}", row[k][:40], f"{wanted[k]!r}, as the header's polynomial"
            )


# ---------------------------------------------------------------- NPZ


def _to_npz(motion: Motion) -> bytes:
    out, parts = io.BytesIO(), _parts(motion)
    header = json.dumps(parts.header | {"sha256": _digest(parts)}, allow_nan=False)
    np.savez(out, header=np.array(header), knots=parts.knots, coefficients=parts.coefficients)
    return out.getvalue()


def _from_npz(content: bytes) -> Motion:
    try:
        header, knots, coefficients = _arrays(content, ("header", "knots", "coefficients"))
    except InvalidInput:
        raise
    except Exception as error:  # zip and NumPy's reader fail in a dozen ways on bytes that are not theirs
        raise InvalidInput("content", f"{type(error).__name__}: {str(error)[:120]}", "an NPZ file, whole") from None
    for name, array, kind in (("header", header, "U"), ("knots", knots, "f"), ("coefficients", coefficients, "f")):
        if array.dtype.kind != kind or (kind == "f" and array.dtype.itemsize != 8):
            raise InvalidInput(name, f"an array of {array.dtype}", "JSON text" if kind == "U" else "float64")
    data = parsed(str(header), "header")
    if not isinstance(data, dict):
        raise InvalidInput("header", repr(data)[:60], "a mapping")
    digest = data.pop("sha256", None)
    return _motion(_checked(Parts(_header(data), knots, coefficients), digest))


def _arrays(content: bytes, names: tuple[str, ...]) -> list[Any]:
    """Arrays of an NPZ file; one that would unpack to more than `UNPACKED`, or claims more than it holds, is not unpacked."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [archive.getinfo(f"{name}.npy") for name in names]
        size = sum(member.file_size for member in members)
        if size > UNPACKED:
            raise InvalidInput("content", f"arrays of {size / 2**20:.0f} MB", f"at most {UNPACKED // 2**20} MB")
        found = []
        for member in members:
            packed = io.BytesIO(archive.read(member))
            version = np.lib.format.read_magic(packed)
            read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
            shape, _, dtype = read(packed)
            claimed, held = math.prod(shape) * dtype.itemsize, member.file_size - packed.tell()
            if claimed != held:
                raise InvalidInput(member.filename, f"{held} bytes for an array of {claimed}", "a whole array")
            packed.seek(0)
            found.append(np.lib.format.read_array(packed, allow_pickle=False))
    return found


# ---------------------------------------------------------------- files

FORMATS = {".npz": (_to_npz, _from_npz), ".json": (_to_json, _from_json), ".csv": (_to_csv, _from_csv)}


def _format(file: str | os.PathLike[str]) -> Any:
    return FORMATS[suffix_of(file, tuple(FORMATS))]
