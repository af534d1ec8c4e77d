"""Entry points of installed packages: things that are found by a name and come from outside."""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.metadata import EntryPoint
from typing import NamedTuple


class RefusedEntryPoint(NamedTuple):
    """An entry point that cannot be used.

    Attributes
    ----------
    group, name : str
        Under which it is registered.
    value : str
        The object that it names, as module:object.
    distribution : str
        The package that registers it.
    reason : str
        Why it is refused.
    """

    group: str
    name: str
    value: str
    distribution: str
    reason: str


def entry_points(group: str) -> Mapping[str, Sequence[EntryPoint]]:
    """Return the entry points of installed packages in a group, by their names; none of them is imported."""
    found: dict[str, list[EntryPoint]] = {}
    for point in _installed(group, tuple(sys.path)):
        found.setdefault(point.name, []).append(point)
    return found


@lru_cache(maxsize=64)
def _installed(group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Entry points of a group along ``sys.path``, kept for as long as that is the same: a look takes milliseconds."""
    return tuple(importlib.metadata.entry_points(group=group))


def describe_distribution(point: EntryPoint) -> str:
    """Return the name and version of the package that an entry point comes from."""
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "an unknown package"
