"""Time laws: one module a law, found by its name; each turns a joint path and limits into a `Trajectory`."""

from __future__ import annotations

import os
from typing import Any

from optik.registry import build_method, names
from planners.timing.base import TimeLaw

__all__ = ["TimeLaw", "laws", "make_law"]


def laws() -> tuple[str, ...]:
    """Names of all time laws."""
    return names("planners.timing")


def make_law(law: str | os.PathLike[str], **options: Any) -> TimeLaw:
    """Build a time law by its name, or from a file that is given as a path.

    Parameters
    ----------
    law : str or path
        A name from `laws`, or a Python file such as ``"./law.py"``, which is run.
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
        An option that the law does not have, or out of range; a file that is no law.
    """
    built: TimeLaw = build_method("planners.timing", law, "time law", **options)
    return built
