"""What all commands share: consoles, options, robots and configurations as people type them."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import numpy as np
import typer
from rich.console import Console

import optik
from optik.arm.units import per, units
from optik.errors import InvalidInput

out_console, err_console = Console(), Console(stderr=True)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of a table.")]
RobotName = Annotated[
    str, typer.Option("--robot", "-r", help="A name from `optik robots`, or a file: .urdf, .toml, .json or .py.")
]
Tip = Annotated[str | None, typer.Option(help="Link of a URDF that is the tool, where it has several ends.")]
Base = Annotated[str | None, typer.Option(help="Link of a URDF that poses are given in; its root if left out.")]

Allowed = Annotated[
    list[str] | None,
    typer.Option(
        "--allow",
        help="Violations to permit, repeated or comma separated: contact, path, limits, jerk, coverage, not_proved.",
    ),
]

Command = TypeVar("Command", bound=Callable[..., Any])


def command(group: typer.Typer, name: str | None = None, **settings: Any) -> Callable[[Command], Command]:
    """Decorate a function as a command whose help is its docstring, without the sections that follow the words.

    Parameters
    ----------
    group : typer.Typer
        Where the command belongs.
    name : str, optional
        Of the command; by default the function's.
    **settings
        Those of `typer.Typer.command`.

    Returns
    -------
    callable
        The decorator; the function stays as it is.
    """

    def register(function: Command) -> Command:
        group.command(name, help=words_of(function), **settings)(function)
        return function

    return register


def words_of(function: Callable[..., Any]) -> str:
    """Return a function's docstring without its sections (Parameters, Raises and so on), for `--help`.

    Parameters
    ----------
    function : callable
        A command.

    Returns
    -------
    str
        Summary and further paragraphs.
    """
    return re.split(r"\n\n?\w+\n-{3,}\n", inspect.getdoc(function) or "")[0]


def arm_of(robot: str, tip: str | None = None, base: str | None = None) -> optik.Robot:
    """Load a robot by its name or from a file.

    Parameters
    ----------
    robot : str
        What ``--robot`` was given.
    tip, base : str, optional
        Links of a URDF.

    Returns
    -------
    Robot
        The arm.

    Raises
    ------
    UnknownName, RobotModelError, InvalidInput
        As `optik.load`.
    """
    return optik.load(robot, tip=tip, base=base)


def either(load: Callable[[str], Any], name: str) -> Any:
    """Load what a name stands for, or return the error: a broken plug-in must not keep the others from being listed.

    Parameters
    ----------
    load : callable
        From a name to what it stands for.
    name : str
        The name.

    Returns
    -------
    object or Exception
        What was loaded, or why it could not be.
    """
    try:
        return load(name)
    except Exception as error:  # code of a package may raise any
        return error


def allowed_words(texts: list[str] | None) -> tuple[str, ...]:
    """Return the words of ``--allow``; raises InvalidInput for one that does not exist."""
    from planners.certificate.failure import check_allow

    words = [word.strip() for text in texts or () for word in text.split(",")]
    try:
        return check_allow(words)
    except InvalidInput as error:
        raise InvalidInput("--allow", ", ".join(words), error.expected) from None


def configuration(arm: optik.Robot, degrees: str, option: str = "--start-deg") -> Any:
    """Read a configuration given in degrees, sliding joints in millimetres; the middle of the ranges if empty.

    Parameters
    ----------
    arm : Robot
        The arm.
    degrees : str
        Joint values, separated by commas or spaces.
    option : str
        Which option they were given with, for messages.

    Returns
    -------
    (n,) array
        Configuration [rad, m].

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
    """Print strict JSON for programs.

    Parameters
    ----------
    data : object
        Plain data.
    """
    print(json.dumps(data, allow_nan=False, indent=1))
