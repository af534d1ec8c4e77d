"""Registry of the kinds of limits: arguments of `MotionLimits`, files of this folder, and those that programs register."""

from __future__ import annotations

from functools import cache

from optik.errors import InvalidInput, UnknownName
from optik.registry import build_method, names
from planners.limits._joint import Acceleration, DerivativeLimit, Jerk, LoadedLimit, Torque, TorqueRate, Velocity
from planners.limits._tool import RotationSpeed, ToolSpeed
from planners.limits.base import Limit

FOLDER = "planners.limits"
"""Folder, and group of entry points, in which each further limit is a file."""
FIELD_LIMITS: tuple[Limit, ...] = (
    Velocity(), Acceleration(), Jerk(), ToolSpeed(), RotationSpeed(), Torque(), TorqueRate()
)  # fmt: skip
"""The limits that are arguments of `MotionLimits`, in the order of its arguments, of files and of reports."""
ALL_LIMITS = tuple(kind.name for kind in FIELD_LIMITS)
"""Names of the limits that are arguments of `MotionLimits`."""
DERIVATIVES = tuple(kind.name for kind in FIELD_LIMITS if isinstance(kind, DerivativeLimit))
"""Names of the limits on derivatives of every joint, by order."""
TOOL_SPEEDS = tuple(kind.name for kind in FIELD_LIMITS if kind.subject == "tool")
"""Names of the limits of the tool."""
LOADED = tuple(kind.name for kind in FIELD_LIMITS if isinstance(kind, LoadedLimit))
"""Names of the limits that need the arm's masses. Files contain them only if they are given."""

_BY_NAME = {kind.name: kind for kind in FIELD_LIMITS}
"""Limits that are fields of `MotionLimits`, by name."""
_ADDED: dict[str, Limit] = {}
"""Limits that `register` added in this process, by name."""


def register(kind: Limit) -> None:
    """Register a kind of limit by its name for ``MotionLimits(extra=...)`` and motion files, in this process."""
    if not isinstance(kind, Limit):
        raise InvalidInput("kind", repr(kind)[:60], "a Limit")
    taken = kind.name in (*ALL_LIMITS, *names(FOLDER)) or type(_ADDED.get(kind.name, kind)) is not type(kind)
    if taken:
        raise InvalidInput("kind", f"the name {kind.name!r}", "a name that no other limit has")
    _ADDED[kind.name] = kind


def is_known(name: object) -> bool:
    """Return whether there is a limit of a name."""
    return name in _BY_NAME or name in _ADDED or name in names(FOLDER)


def check_names(names: object, argument: str) -> tuple[str, ...]:
    """Check that a tuple consists of names of limits, and return it."""
    expected = f"a tuple of names of limits, out of {', '.join((*ALL_LIMITS, *_ADDED))}"
    if not isinstance(names, tuple):
        raise InvalidInput(argument, repr(names)[:60], expected)
    unknown = [name for name in names if not is_known(name)]
    if unknown:
        raise InvalidInput(argument, repr(unknown[0])[:60], expected)
    return names


def kind_of(name: str) -> Limit:
    """Return the kind of limit of a name."""
    found = _BY_NAME.get(name) or _ADDED.get(name)
    if found is not None:
        return found
    if name not in names(FOLDER):
        raise UnknownName("limit", name, (*ALL_LIMITS, *names(FOLDER), *_ADDED))
    return _from_folder(name)


@cache
def _from_folder(name: str) -> Limit:
    kind: Limit = build_method(FOLDER, name, "limit")
    return kind
