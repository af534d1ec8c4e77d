"""Cartesian paths: one file a path; a path knows where the tool is at s, and how it turns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.registry import load_method, names
from planners.paths.base import Path

__all__ = ["Path", "path_of", "paths"]


def paths() -> tuple[str, ...]:
    """Names of all paths."""
    return names("planners.paths")


def path_of(data: Mapping[str, Any], robot: Robot | None = None) -> Path:
    """Rebuild a path from the plain data that its `to_dict` wrote.

    Parameters
    ----------
    data : mapping
        With the path's name in ``path``.
    robot : Robot, optional
        The arm; a path that is given in the joints needs it.

    Returns
    -------
    Path
        With the same poses to the last bit.

    Raises
    ------
    InvalidInput
        Data that describe no path.
    UnknownName
        No such path; the nearest names are offered.
    """
    if not isinstance(data, Mapping) or "path" not in data:
        raise InvalidInput("data", repr(data)[:60], "a mapping with the name of a path in 'path'")
    built: Path = load_method("planners.paths", data["path"], "path").from_dict(data, robot)
    return built
