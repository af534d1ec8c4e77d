"""Drives, which execute certified plans on one arm. Each drive is a module that is found by its name."""

from __future__ import annotations

import os
from typing import Any

from optik.arm.robot import Robot
from optik.registry import build_method, names
from planners.cell.drives._run import Commands, Steps
from planners.cell.drives._simulated import SimulatedDrive
from planners.cell.drives.base import Drive

__all__ = ["Commands", "Drive", "SimulatedDrive", "Steps", "drives", "make_drive"]


def drives() -> tuple[str, ...]:
    """Return the names of all drives."""
    return names("planners.cell.drives")


def make_drive(drive: str | os.PathLike[str], robot: Robot, **options: Any) -> Drive:
    """Build a drive by its name, or from a file that is given as a path.

    Parameters
    ----------
    drive : str or path
        A name from `drives`, or a Python file, which is run.
    robot : Robot
        The arm that it drives.
    **options
        Options of the drive.

    Returns
    -------
    Drive
        The drive.

    Raises
    ------
    UnknownName
        No such drive; the message lists the nearest names.
    InvalidInput
        An option that the drive does not have, or that is out of range.
    MissingDependency
        The drive needs a package that is not installed.
    """
    built: Drive = build_method("planners.cell.drives", drive, "drive", robot, **options)
    return built
