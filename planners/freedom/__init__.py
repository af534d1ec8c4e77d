"""Freedoms of a path, one module for each: coordinates that the task leaves to the planner."""

from __future__ import annotations

from functools import cache

from optik.errors import UnknownName
from optik.registry import build_method, find_loaded, names
from planners.freedom.base import Freedom

__all__ = ["Freedom", "freedom_of", "freedoms", "loaded_freedom"]


def freedoms() -> tuple[str, ...]:
    """Return the names of all freedoms.

    Returns
    -------
    tuple of str
        Sorted.
    """
    return names("planners.freedom")


@cache
def freedom_of(name: str) -> Freedom:
    """Return the freedom of a name; raise UnknownName if there is none."""
    found: Freedom = build_method("planners.freedom", name, "freedom")
    return found


def loaded_freedom(name: str) -> Freedom:
    """Return the freedom of a name without running a file; raise UnknownName if this process has none of this name."""
    kind: type[Freedom] | None = find_loaded("planners.freedom", name)
    if kind is None:
        advice = "a file's freedom is known once `planners.free` has loaded it"
        raise UnknownName("freedom", str(name), freedoms(), advice)
    return kind()
