"""Time laws: one module a law, found by its name; each turns a joint path and limits into a `Trajectory`."""

from __future__ import annotations

import os
from typing import Any

from optik.registry import build_method, names
from planners.timing.base import TimeLaw, check_law

__all__ = ["TimeLaw", "law_for", "laws", "make_law"]


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
        An option that the law does not have, or out of range; a file that is no law, or whose
        ``enforced`` is no tuple of names of limits.
    """
    return check_law(build_method("planners.timing", law, "time law", **options))


def law_for(timing: str | os.PathLike[str] | TimeLaw) -> TimeLaw:
    """Return a time law that is given by name, as a file or built.

    Parameters
    ----------
    timing : str, path or TimeLaw
        What `make_law` takes, or a law.

    Returns
    -------
    TimeLaw
        The law.

    Raises
    ------
    UnknownName
        No such law; the nearest names are offered.
    InvalidInput
        No law, a file that is no law, or a law whose ``enforced`` is no tuple of names of limits.
    """
    return make_law(timing) if isinstance(timing, str | os.PathLike) else check_law(timing)
