"""Entry points of installed packages."""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.metadata import EntryPoint
from typing import NamedTuple


class RefusedEntryPoint(NamedTuple):
    """An entry point that cannot be used: its registration, the object (module:object), its package, and the reason."""

    group: str
    name: str
    value: str
    distribution: str
    reason: str


def entry_points(group: str) -> Mapping[str, Sequence[EntryPoint]]:
    """Return the entry points of installed packages in a group by name, without importing them."""
    found: dict[str, list[EntryPoint]] = {}
    for point in _installed(group, tuple(sys.path)):
        found.setdefault(point.name, []).append(point)
    return found


@lru_cache(maxsize=64)
def _installed(group: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the entry points of a group along ``sys.path``; cached, because the search takes milliseconds."""
    return tuple(importlib.metadata.entry_points(group=group))


def describe_distribution(point: EntryPoint) -> str:
    """Return the name and version of an entry point's package."""
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "an unknown package"
