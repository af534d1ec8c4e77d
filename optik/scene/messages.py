"""ROS messages as plain data of YAML or JSON: their forms in ROS 1 and 2, and the defaults of missing fields."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from optik import se3
from optik.arm.plain import make_rotation, read_list
from optik.check import check_number, format_value
from optik.errors import InvalidInput
from optik.types import Array

NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second; ROS times are whole nanoseconds."""
LONGEST_DURATION = 2**31 - 1
"""Longest ROS duration [s]: its seconds are a signed integer of 32 bits."""
TIME_FORMS = (("sec", "nanosec"), ("secs", "nsecs"))
"""Fields of a time in ROS 2 and in ROS 1."""
POINT_DEFAULTS, ROTATION_DEFAULTS = {"x": 0.0, "y": 0.0, "z": 0.0}, {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
"""Fields of a point or vector, and of a quaternion, with their defaults."""


def find_mappings(data: Any) -> Iterator[dict[str, Any]]:
    """Yield all mappings in nested plain data, the outermost first."""
    todo, seen = [data], set[int]()
    for value in todo:  # the list grows during the loop
        if isinstance(value, dict | list) and id(value) not in seen:  # YAML aliases can repeat a mapping
            seen.add(id(value))
            todo += value.values() if isinstance(value, dict) else value
            if isinstance(value, dict):
                yield value


def read_fields(value: Any, where: str, known: Iterable[str] | None = None) -> dict[str, Any]:
    """Check that a value is a mapping, with known fields only."""
    if not isinstance(value, dict):
        raise InvalidInput(where, format_value(value), "a mapping of named fields")
    for other in (key for key in value if known is not None and key not in known):
        raise InvalidInput(where, f"the field {other!r}"[:60], f"some of {', '.join(known or ())}")
    return value


def read_rows(value: dict[str, Any], key: str, where: str) -> list[Any]:
    """Read a list of a message; a missing one is empty."""
    return read_list(value.get(key) or [], f"{where}.{key}", "a list")


def read_floats(value: Any, where: str, count: int, fields: dict[str, float] | None = None) -> Array:
    """Read finite numbers (count,) from a list or from named fields with defaults; YAML 1.1 reads 1e-5 as text."""
    expected = f"{count} finite numbers"
    if isinstance(value, dict) and fields is not None:
        value = list((fields | read_fields(value, where, fields)).values())
    rows = read_list(value, where, expected, count)
    if all(type(x) is float for x in rows) and np.isfinite(array := np.array(rows)).all():
        return array
    out = []
    for x in rows:
        try:
            x = float(x) if isinstance(x, str) else x
        except ValueError:
            raise InvalidInput(where, format_value(x), expected) from None
        out.append(check_number(x, where, expected))
    return np.array(out)


def read_pose(value: Any, where: str, names: tuple[str, str] = ("position", "orientation")) -> Array:
    """Read a pose (4, 4) [1, m] from a point and a quaternion x, y, z, w; missing fields are 0, a missing w is 1."""
    parts = read_fields(value, where, names)
    p = read_floats(parts.get(names[0], {}), f"{where}.{names[0]}", 3, POINT_DEFAULTS)
    q = read_floats(parts.get(names[1], {}), f"{where}.{names[1]}", 4, ROTATION_DEFAULTS)
    return se3.pose(make_rotation("quaternion_xyzw", q, f"{where}.{names[1]}"), p)


def read_time(value: Any, where: str) -> int:
    """Read a time or duration [ns], of ROS 2 or 1, or in float seconds; missing fields are 0."""
    if type(value) is float and 0.0 <= value <= LONGEST_DURATION:
        return round(value * NANOSECONDS)
    if isinstance(value, dict):
        for fields in TIME_FORMS:
            sec, nanosec = (value.get(field, 0) for field in fields)
            good = type(sec) is int and type(nanosec) is int and set(value) <= set(fields)
            if good and 0 <= sec <= LONGEST_DURATION and 0 <= nanosec < NANOSECONDS:
                return int(sec * NANOSECONDS + nanosec)
    expected = "sec and nanosec, integers from 0; secs and nsecs of ROS 1; or seconds with a decimal point"
    raise InvalidInput(where, repr(value)[:80], expected)
