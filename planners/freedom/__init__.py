"""Freedoms of a path, one module for each: coordinates that the task leaves to the planner."""

from __future__ import annotations

from functools import cache

from optik.registry import build_method, names
from planners.freedom.base import Freedom

__all__ = ["Freedom", "freedom_of", "freedoms"]


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
