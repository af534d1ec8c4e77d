"""Time laws: one module a law, found by its name; each turns a joint path and limits into a `Trajectory`."""

from __future__ import annotations

from typing import Any

from optik.registry import build_method, names
from planners.timing.base import TimeLaw

__all__ = ["TimeLaw", "laws", "make_law"]


def laws() -> tuple[str, ...]:
    """Names of all time laws."""
    return names("planners.timing")


def make_law(law: str, **options: Any) -> TimeLaw:
    """Build a time law by name.

    Parameters
    ----------
    law : str
        A name from `laws`.
    **options
        Options of the law.

    Returns
    -------
    TimeLaw
        The law.

    Raises
    ------
    UnknownName
        No such law; the nearest names are offered.
    InvalidInput
        An option that the law does not have, or out of range.
    """
    built: TimeLaw = build_method("planners.timing", law, "time law", **options)
    return built
