"""What all commands share: consoles, options, robots and configurations as people type them."""

from __future__ import annotations

import json
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

import optik
from optik.arm.units import per, units
from optik.errors import InvalidInput

out_console, err_console = Console(), Console(stderr=True)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of a table.")]
RobotName = Annotated[str, typer.Option("--robot", "-r", help="A name from `optik robots`, or a URDF file.")]


def arm_of(robot: str) -> optik.Robot:
    """Load a robot by its name, or read it from a URDF file.

    Raises
    ------
    UnknownName, RobotModelError, InvalidInput
        As `optik.load` and `Robot.from_urdf`.
    """
    return optik.Robot.from_urdf(robot) if robot.lower().endswith((".urdf", ".xml")) else optik.load(robot)


def configuration(arm: optik.Robot, degrees: str, option: str = "--start-deg") -> Any:
    """Read a configuration given in degrees, sliding joints in millimetres; the middle of the ranges if empty.

    Raises
    ------
    InvalidInput
        Not numbers, the wrong count, or outside the limits.
    """
    if not degrees.strip():
        return arm.limits.middle
    try:
        values = [float(v) for v in degrees.replace(",", " ").split()]
    except ValueError:
        raise InvalidInput(option, repr(degrees), f"{arm.n} numbers in degrees, comma separated") from None
    if len(values) != arm.n:
        expected = f"{arm.n} joint values of {arm.name} [degrees, mm], comma separated"
        raise InvalidInput(option, f"{len(values)}: {degrees}", expected)
    q = arm.configuration(values, option) / per(arm)
    lower, upper = arm.limits.lower, arm.limits.upper
    if not arm.limits.contains(q):
        i = int(np.argmax(np.maximum(lower - q, q - upper)))
        scale, unit = per(arm)[i], units(arm)[i]
        room = f"within [{lower[i] * scale:g}, {upper[i] * scale:g}]{unit}, its range"
        raise InvalidInput(option, f"{arm.joint_names[i]} = {values[i]:g}{unit}", f"{arm.joint_names[i]} {room}")
    return q


def print_json(data: Any) -> None:
    """Print strict JSON for programs."""
    print(json.dumps(data, allow_nan=False, indent=1))
