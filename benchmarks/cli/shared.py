"""Consoles, options, and readers of robots and configurations, common to all commands."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import takewhile
from typing import Annotated, Any, TypeVar

import numpy as np
import typer
from rich.console import Console
from typer.core import TyperCommand

import optik
from optik.arm.units import unit_factors, unit_names
from optik.errors import InvalidInput
from optik.plugins.files import is_path, split_links

out_console, err_console = Console(), Console(stderr=True)

NUMBERS, Q_DEG = "NUMBERS", "Q_DEG"
"""Metavars of vector options and arguments: one argument, with commas or quoted spaces."""

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
RobotName = Annotated[
    str, typer.Option("--robot", "-r", help="A name from `optik robots`, or a file: .urdf, .toml, .json or .py.")
]
PackageDir = Annotated[
    str | None,
    typer.Option(
        help="Folder of ROS packages for package:// meshes of a URDF, whose collision shapes are then loaded."
    ),
]
Tip = Annotated[str | None, typer.Option(help="Tool link of a URDF; required if it has several ends.")]
Base = Annotated[str | None, typer.Option(help="Base link of a URDF, in which poses are given; by default its root.")]

Allowed = Annotated[
    list[str] | None,
    typer.Option(
        "--allow",
        help="Permitted violations, repeated or comma separated: contact, path, limits, jerk, coverage, not_proved.",
    ),
]

Command = TypeVar("Command", bound=Callable[..., Any])


class NumbersCommand(TyperCommand):
    """A command that refuses a vector typed as several arguments, with the correct form in the error."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Check the arguments before they are parsed."""
        vectors = {name for p in self.params if getattr(p, "metavar", None) == NUMBERS for name in p.opts}
        for i, arg in enumerate(args):
            name, equals, value = arg.partition("=")
            run = list(takewhile(_is_number, [*([value] if equals else []), *args[i + 1 :]]))
            if name in vectors and len(run) > 1:
                raise InvalidInput(
                    name, f"{len(run)} arguments: {' '.join(run)}", f"one argument: {name} {','.join(run)}"
                )
        found = [arg for arg in args if _is_number(arg)]
        if len(found) > 1 and any(getattr(p, "metavar", None) == Q_DEG for p in self.params):
            raise InvalidInput(Q_DEG, f"{len(found)} arguments: {' '.join(found)}", f"one argument: {','.join(found)}")
        return list(super().parse_args(ctx, args))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


StartDeg = Annotated[
    str,
    typer.Option(
        metavar=NUMBERS,
        help="Start configuration [degrees, sliding mm]: 20,-35,40; by default the arm's home, or else a sampled one.",
    ),
]


def command(group: typer.Typer, name: str | None = None, **settings: Any) -> Callable[[Command], Command]:
    """Decorate a function as a command whose help is its docstring."""
    return group.command(name, cls=NumbersCommand, **settings)


def load_arm(
    robot: str, tip: str | None = None, base: str | None = None, package_dir: str | None = None
) -> optik.Robot:
    """Load a robot by its name or from a file."""
    if package_dir is not None:
        path, options = split_links(robot)
        if not is_path(robot) or not path.lower().endswith((".urdf", ".xml")):
            raise InvalidInput("--package-dir", package_dir, f"no --package-dir, because {robot} is not a URDF")
        robot = f"{path}#{options}{'&' if options else ''}packages={package_dir}"
    return optik.load(robot, tip=tip, base=base)


def load_or_error(load: Callable[[str], Any], name: str) -> Any:
    """Load a named object, or return the error: a broken plug-in must not prevent a list of the others."""
    try:
        return load(name)
    except Exception as error:  # a package may raise anything
        return error


def read_allowed(texts: list[str] | None) -> tuple[str, ...]:
    """Return the words of ``--allow``; raises InvalidInput for one that does not exist."""
    from planners.certificate.violation import check_allow

    words = [word.strip() for text in texts or () for word in text.split(",")]
    try:
        return check_allow(words)
    except InvalidInput as error:
        raise InvalidInput("--allow", ", ".join(words), error.expected) from None


def read_configuration(arm: optik.Robot, text: str, option: str = "--start-deg") -> Any:
    """Read a configuration given in degrees, sliding joints in millimetres."""
    values = read_numbers(text, option, arm.n, what=f"joint values of {arm.name} [degrees, sliding mm]")
    q = arm.configuration(values, option) / unit_factors(arm)
    lower, upper = arm.limits.lower, arm.limits.upper
    if not arm.limits.contains(q):
        i = int(np.argmax(np.maximum(lower - q, q - upper)))
        scale, unit = unit_factors(arm)[i], unit_names(arm)[i]
        room = f"within [{lower[i] * scale:g}, {upper[i] * scale:g}]{unit}, its range"
        raise InvalidInput(option, f"{arm.joint_names[i]} = {values[i]:g}{unit}", f"{arm.joint_names[i]} {room}")
    return q


def read_numbers(text: str, option: str, *counts: int, what: str = "numbers") -> list[float]:
    """Read numbers separated by commas or spaces; `counts` are the permitted numbers of them."""
    expected = f"{' or '.join(map(str, counts)) or 'one or more'} {what} in one argument, such as 1,-2.5,3"
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise InvalidInput(option, repr(text), expected) from None
    if not values or (counts and len(values) not in counts):
        raise InvalidInput(option, f"{text!r}, {len(values)} number{'s' * (len(values) != 1)}", expected)
    return values


def format_numbers(values: Any) -> str:
    """Return numbers as one argument of a command, rounded to 0.001."""
    return ",".join(f"{round(float(value), 3) + 0.0:g}" for value in values)


# ---------------------------------------------------------------- the default start

START_SAMPLES = 64
"""Number of random configurations; the best-conditioned one is the start of an arm without home_deg."""


def read_start(arm: optik.Robot, name: str, text: str) -> tuple[Any, str]:
    """Return the typed start, or the arm's default start with a sentence on it."""
    if text.strip():
        return read_configuration(arm, text), ""
    from optik.arm.library import read_home

    home = read_home(name)
    q, why = (
        (sample_start(arm), "a sample, because it has no home_deg")
        if home is None
        else (home / unit_factors(arm), "its home_deg")
    )
    return q, f"start of {arm.name}, {why}: --start-deg {format_numbers(q * unit_factors(arm))}"


def print_start(words: str) -> None:
    """Print the default start on the error stream, which keeps the output stream for programs."""
    if words:
        err_console.print(words, highlight=False, markup=False, soft_wrap=True)


def sample_start(arm: optik.Robot) -> Any:
    """Return the best-conditioned of 64 fixed random configurations inside the joint ranges and without self-contact."""
    q = np.round(arm.limits.sample(np.random.default_rng(0), START_SAMPLES) * unit_factors(arm), 1) / unit_factors(arm)
    q = arm.limits.clip(q)
    if arm.shapes is not None:
        from optik.scene.contact import find_nearest_pairs

        free = find_nearest_pairs(arm, optik.Scene(), q)[0] > 0.0
        q = q[free] if free.any() else q
    sigma = arm.singular_values(q)
    return q[np.argmax(sigma[:, -1] / sigma[:, 0])]


def print_json(data: Any) -> None:
    """Print strict JSON."""
    print(json.dumps(data, allow_nan=False, indent=1))
