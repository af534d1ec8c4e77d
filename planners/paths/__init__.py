"""Paths of the tool, one module for each: poses and twists over the path parameter s."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from optik.arm.robot import Robot
from optik.errors import InvalidInput, UnknownName
from optik.registry import find_loaded, load_method, names, short_name
from planners.paths.base import Path
from planners.paths.point_to_point import ViaPoint

__all__ = ["Path", "ViaPoint", "make_path", "path_of", "paths"]


def paths() -> tuple[str, ...]:
    """Return the names of all paths, those of installed packages included.

    Returns
    -------
    tuple of str
        Sorted.
    """
    return names("planners.paths")


def make_path(path: str | os.PathLike[str], robot: Robot | None = None, **data: Any) -> Path:
    """Return a path built from plain data by its name, or by a plug-in file.

    Parameters
    ----------
    path : str or path
        A name from `paths`, or a Python file such as ``"./spiral.py"``, which is run.
    robot : Robot, optional
        The arm; a path in joint space needs it.
    **data
        What its `Path.to_dict` returns, without ``path``.

    Returns
    -------
    Path
        As its ``from_dict`` builds it.

    Raises
    ------
    InvalidInput
        Data that describe no such path; a key that it does not have.
    UnknownName
        No such path; the nearest names are offered.
    """
    kind: type[Path] = load_method("planners.paths", path, "path")
    built = kind.from_dict({"path": short_name(path)} | data, robot)
    known = built.to_dict()
    for key in data:
        if key not in known:
            keys = ", ".join(k for k in known if k != "path")
            raise InvalidInput(key, repr(data[key])[:60], f"keys of the path {short_name(path)!r}: {keys}")
    return built


def path_of(data: Mapping[str, Any], robot: Robot | None = None) -> Path:
    """Return the path whose `to_dict` wrote this plain data; no file that the data name is run.

    Parameters
    ----------
    data : mapping
        With the path's name in ``path``.
    robot : Robot, optional
        The arm; a path in joint space needs it.

    Returns
    -------
    Path
        With poses equal to the last bit.

    Raises
    ------
    InvalidInput
        Data that describe no path.
    UnknownName
        No such path; the nearest names are offered. A path of a plug-in file is known once `make_path` has loaded it.
    """
    if not isinstance(data, Mapping) or not isinstance(data.get("path"), str):
        raise InvalidInput("data", repr(data)[:60], "a mapping with the name of a path in 'path'")
    name = data["path"]
    kind: type[Path] | None = find_loaded("planners.paths", name)
    if kind is None:
        raise UnknownName("path", str(name), paths())
    return kind.from_dict(data, robot)
