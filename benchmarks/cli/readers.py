"""Readers of vectors, configurations and other typed values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from itertools import cycle, islice
from math import isfinite
from typing import Any

import numpy as np

import optik
from optik.arm.model import check_range, unit_factors
from optik.arm.motors import from_maker
from optik.check import format_count
from optik.errors import InvalidInput
from optik.registry import names

LIMIT_HELP = (
    f"Further limit, repeatable: {''.join(f'{name}, ' for name in names('planners.limits'))}or a file, ./weighted_speed.py=3; "
    "one number, or one for each joint, in the limit's units or with deg or mm; fields as in grip=friction:0.4,force:40; "
    "vectors as in com:0/0/50mm; none removes one of the robot's."
)
"""Help of ``--limit``."""
ALLOW_HELP = (
    "Violations to permit, comma separated or repeated: contact (or a distance below the margin), path (error above the "
    "tolerance), limits (one or a joint range is exceeded, or a jump), jerk (its limit is exceeded), coverage (a part of the "
    "path is missing), not_proved (a bound is neither violated nor proved)."
)
"""Help of ``--allow``."""


def read_configuration(arm: optik.Robot, text: str, name: str = "--start-deg") -> Any:
    """Read a configuration given in degrees, prismatic joints in millimetres."""
    return check_range(arm, from_maker(arm, read_joint_values(arm, text, name) / unit_factors(arm)), name)


def read_joint_values(arm: optik.Robot, text: str, name: str) -> Any:
    """Read one finite number per joint."""
    values = read_number_list(text, name, arm.n, what=f"joint values of {arm.name} [degrees, prismatic mm]")
    return arm.configuration(values, name)


def read_number_list(text: str, name: str, *counts: int, what: str = "numbers", infinite: bool = False) -> list[float]:
    """Read numbers separated by commas or spaces; `counts` are the permitted numbers of them."""
    such = ",".join(islice(cycle(("1", "-2.5", "3")), counts[0] if counts else 3))
    expected = f"{' or '.join(map(str, counts)) or 'one or more'} {what}, such as {such}"
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise InvalidInput(name, repr(text), expected) from None
    if not all(map(isfinite, values)) and not infinite:
        raise InvalidInput(name, repr(text), "finite numbers")
    if not values or (counts and len(values) not in counts):
        raise InvalidInput(name, f"{text!r}, {format_count(len(values), 'number')}", expected)
    return values


def read_bound(text: str, name: str) -> Any:
    """Read the bound of a limit: one number, or several as a list."""
    values = read_number_list(text, name, infinite=True)
    return values if len(values) > 1 else values[0]


UNITS = {"deg": ("rad", np.pi / 180.0), "mm": ("m", 1e-3)}
"""Units that a number may end with: that of the limit which permits it, and the factor."""


def read_limit(name: str, text: str) -> Any:
    """Read the bound of a further limit: numbers, ``none``, or the fields of a record, such as ``friction:0.4,force:40``."""
    from planners.limits import kind_of
    from planners.limits.record import RecordLimit

    kind, where = kind_of(name), f"--limit {name}"
    if text.strip() == "none":
        return None
    if not isinstance(kind, RecordLimit):
        return read_bound(_in_units(text, kind.units[0], where), where)
    units = {field.name: field.metadata.get("unit", "") for field in fields(kind.record)}
    pairs = [word.partition(":") for word in text.split(",")]
    if not pairs[0][1]:  # the first field alone needs no name
        pairs[0] = (next(iter(units)), ":", pairs[0][0])
    values: dict[str, Any] = {}
    for key, colon, value in pairs:
        if not colon or key not in units or key in values:
            raise InvalidInput(
                where, repr(text), f"{', '.join(f'{key}:…' for key in units)}, each at most once, or none"
            )
        words = value.split("/")
        if value.removeprefix("-") in ("x", "y", "z"):
            values[key] = value
        else:
            numbers = [
                read_number_list(_in_units(word, units[key], where), where, 1, what="number", infinite=True)[0]
                for word in words
            ]
            values[key] = numbers if len(numbers) > 1 else numbers[0]
    return kind.check(values)


def _in_units(text: str, unit: str, where: str) -> str:
    """Return numbers in SI units from those that end with deg or mm."""
    for suffix, (of, factor) in UNITS.items():
        if text.endswith(suffix):
            if unit.split("/")[0] != of:
                raise InvalidInput(where, repr(text), f"a number in {unit}, without {suffix}")
            return repr(float(read_number_list(text.removesuffix(suffix), where, 1, what="number")[0] * factor))
    return text


def read_held(texts: list[str] | None) -> dict[str, float] | None:
    """Read JOINT=VALUE of held joints [rad, m]; None if there are none."""
    found: dict[str, float] = {}
    for text in texts or ():
        name, equals, value = (word.strip() for word in text.rpartition("="))
        if not equals or not name or name in found:
            raise InvalidInput("--hold", repr(text), "JOINT=VALUE, each joint once, such as gripper=0.3")
        found[name] = read_number_list(value, "--hold", 1)[0]
    return found or None


def read_freedoms(arm: optik.Robot, texts: list[str]) -> dict[str, Any]:
    """Read NAME[=RANGE] of freedoms, in degrees or mm; return their bounds [rad, m], or True for none."""
    from planners.freedom import freedom_of

    freedoms: dict[str, Any] = {}
    for text in ",".join(texts).split(",") if texts else ():
        name, equals, value = (word.strip() for word in text.partition("="))
        kind = freedom_of(name)
        factor, unit, most = (np.pi / 180.0, "degrees", ", at most 180") if kind.unit == "rad" else (1e-3, "mm", "")
        form = f"RADIUS above 0{most}" if kind.round else f"90 or {name}=-90:45"
        typed = f"{name}, {name}={form} [{unit}]"
        if name in freedoms:
            raise InvalidInput("--free", f"{name} twice", "each freedom once")
        if not kind.screws and arm.n <= 6:
            raise InvalidInput(
                "--free", f"{name} for {arm.name} with {arm.n} joints", "an arm with more than six joints"
            )
        try:
            bounds = tuple(float(word) * factor for word in value.split(":") if equals)
            freedoms[name] = True if not equals else bounds[0] if len(bounds) == 1 else bounds
            kind.check(freedoms[name])
        except (ValueError, InvalidInput):
            order = "" if kind.round else ", the lower bound first" + ("" if kind.screws else f", {name}=0 inside")
            raise InvalidInput("--free", repr(text), f"{typed}{order}") from None
    return freedoms


def format_numbers(values: Any) -> str:
    """Return numbers as one argument of a command, rounded to 0.001."""
    return ",".join(f"{round(float(value), 3) + 0.0:g}" for value in values)


def read_allowed(texts: list[str] | None) -> tuple[str, ...]:
    """Return the words of ``--allow``; raises InvalidInput for one that does not exist."""
    from planners.certificate.violation import check_allow

    words = [word.strip() for text in texts or () for word in text.split(",")]
    try:
        return check_allow(words)
    except InvalidInput as error:
        raise InvalidInput("--allow", ", ".join(words), error.expected) from None


def load_or_error(load: Callable[[str], Any], name: str) -> Any:
    """Load a named object, or return the error: a broken plug-in must not prevent a list of the others."""
    try:
        return load(name)
    except Exception as error:  # a package may raise anything
        return error
