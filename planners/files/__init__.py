"""Motion files: one module for each format, found by the file's suffix or by its name; YAML is for messages of ROS."""

from __future__ import annotations

import os
from pathlib import Path as FilePath

from optik.errors import InvalidInput, OptikError
from optik.file_io import check_suffix, read_bytes, write_atomically
from optik.registry import build_method, names
from planners.certificate.violation import Allow
from planners.files.base import Format
from planners.motion import HasMotion, Motion, get_motion
from planners.ros.export import YAML_SUFFIXES, RosExport, to_ros

__all__ = ["Format", "check_output", "formats", "load_motion", "save"]


def formats() -> tuple[str, ...]:
    """Return the names of all formats, which are the suffixes of their files."""
    return names("planners.files")


def save(
    motion: Motion | HasMotion,
    file: str | os.PathLike[str],
    *,
    format: str | os.PathLike[str] | None = None,
    rate: float | None = None,
    allow: Allow = (),
) -> RosExport | None:
    """Write a valid motion to a file, atomically, in the format of its suffix or in a named one.

    Every format holds the arm, the path, the limits, the law's name, the limits that the motion must respect, and the exact
    polynomials. The motion is certified before it is written. In ``.yaml`` and ``.yml`` it is the message of `to_ros`.

    Parameters
    ----------
    motion : Motion or Plan
        The motion to write.
    file : str or path
        Its suffix is the name of a format, one of `planners.files.formats`, or that of a message.
    format : str or path, optional
        Name of the format, or a Python file such as ``"./tsv.py"``, which is run; by default the suffix is the name.
    rate : float, optional
        Points per second [1/s] of a format with points, such as CSV, and of a message; by default points at the knots.
    allow : str or several
        Violations to permit: ``"contact"``, ``"path"``, ``"limits"``, ``"jerk"``, ``"coverage"``, ``"not_proved"``. With all
        of them the motion is not certified.

    Returns
    -------
    RosExport or None
        For a message, the result of `to_ros`.

    Raises
    ------
    InvalidMotion
        The motion has a violation that ``allow`` does not permit. The error states its size, where it is, and the word.
    InvalidInput
        A suffix that is not a format, or a rate for a format without points.
    UnknownName
        No format has that name.
    MissingDependency
        The format needs a package that is not installed.
    NoSolution
        A plan that failed.
    OutputError
        The file cannot be written.
    """
    chosen, motion = check_output(file, format=format, rate=rate), get_motion(motion)
    if chosen is None:
        return to_ros(motion, file, rate=rate, allow=allow)
    motion.check_valid(allow)
    content = chosen.to_bytes(motion)
    write_atomically(file, lambda part: part.write_bytes(content))
    return None


def check_output(
    file: str | os.PathLike[str], *, format: str | os.PathLike[str] | None = None, rate: float | None = None
) -> Format | None:
    """Return the format in which `save` writes a file, None for a message of ROS; raise InvalidInput if there is none."""
    known = (*(f".{name}" for name in formats()), *YAML_SUFFIXES)
    if format is None and check_suffix(file, known) in YAML_SUFFIXES:
        return None
    return _format(file, format, **({} if rate is None else {"rate": rate}))


def load_motion(file: str | os.PathLike[str], *, format: str | os.PathLike[str] | None = None) -> Motion:
    """Read a motion that `save` wrote, equal to the last bit; `Motion.certify` returns the same certificate.

    Parameters
    ----------
    file : str or path
        The file.
    format : str or path, optional
        Name of the format, or a Python file such as ``"./tsv.py"``, which is run; by default the suffix is the name.

    Returns
    -------
    Motion
        The motion with its arm, path and limits.

    Raises
    ------
    InvalidInput
        No such file, a suffix that is not a format, or damaged content. No code is run from the file.
    UnknownName
        No format has that name.
    MissingDependency
        The format needs a package that is not installed.
    """
    chosen = _format(file, format)
    content = read_bytes(FilePath(file))
    try:
        return chosen.from_bytes(content)
    except InvalidInput as error:
        raise InvalidInput(f"{file}: {error.argument}", error.got, error.expected, advice=error.advice) from None
    except OptikError as error:
        raise InvalidInput(str(file), str(error), "a complete motion") from None


def _format(file: str | os.PathLike[str], name: str | os.PathLike[str] | None, **options: float) -> Format:
    """Return the named format, or that of the file's suffix."""
    if name is None:
        name = check_suffix(file, tuple(f".{known}" for known in formats()))[1:]
    elif not isinstance(file, str | os.PathLike):
        raise InvalidInput("file", repr(file)[:120], "a path")
    built: Format = build_method("planners.files", name, "file format", **options)
    return built
