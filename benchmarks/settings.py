"""Checks of the tables, lists, names, numbers and targets of a suite file; errors name the place of a wrong value."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.plugins.options import find_nearest_name
from optik.registry import check_name

Item = TypeVar("Item")

NAMED_KEYS = {
    "robot": ("optik.robots", "robot"),
    "set": ("benchmarks.problems", "problem set"),
    "solver": ("optik.ik", "IK method"),
    "law": ("planners.timing", "time law"),
}
"""Keys whose value is a name or the path of a file: group, and what errors call it. They mean the same in every kind."""


@dataclass(frozen=True)
class Target:
    """A bound that a measure of a block must keep.

    Attributes
    ----------
    measure : str
        One of the measures of the block; its last part is the unit.
    method : str
        Label of the method or law that the bound applies to; empty if the block has only one.
    to : str
        Label of the method or peer whose value is the denominator of ``median_ratio``.
    group : str
        The part of the problems that the bound applies to: a kind of line or a robot; empty for all.
    at_most, at_least : float or None
        The bound, as one of the two.
    goal : bool
        Whether the target is only a goal: the report does not count a missed goal as a failure.
    """

    measure: str
    method: str = ""
    to: str = ""
    group: str = ""
    at_most: float | None = None
    at_least: float | None = None
    goal: bool = False


def bounds(data: dict[str, Any], where: str) -> dict[str, Any]:
    """Read the bound of a target and whether it is a goal."""
    if ("at_most" in data) == ("at_least" in data):
        others = sorted(set(data) - {"measure"})
        raise InvalidInput(where, f"{data['measure']} with {others}", "either at_most or at_least")
    found: dict[str, Any] = {
        key: check_number(data[key], f"{where}: {key}", "a number") for key in ("at_most", "at_least") if key in data
    }
    if not isinstance(data.get("goal", False), bool):
        raise InvalidInput(f"{where}: goal", repr(data["goal"])[:60], "true or false")
    return found | {"goal": data.get("goal", False)}


@contextmanager
def naming(where: str) -> Iterator[None]:
    """Say in errors of misuse where the wrong value stands: of several blocks a reader must know which."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error.argument}", error.got, error.expected) from error


def check_keys(data: Any, known: set[str], where: str, need: set[str] | None = None) -> None:
    """Raise InvalidInput unless data is a table with all required and only known keys."""
    check_table(data, where)
    if unknown := sorted(set(data) - known):
        near = find_nearest_name(unknown[0], known)
        meant = f"{near!r}, or another of" if near else "keys out of"
        raise InvalidInput(where, f"the key {unknown[0]!r}", f"{meant} {', '.join(sorted(known))}")
    if missing := sorted((need or set()) - set(data)):
        raise InvalidInput(where, f"no {missing[0]!r}", f"the keys {', '.join(sorted(need or set()))}")


def check_table(value: Any, where: str) -> dict[str, Any]:
    """Return the value if it is a table."""
    if not isinstance(value, dict):
        raise InvalidInput(where, type(value).__name__, "a table")
    return value


def check_list(value: Any, where: str) -> list[Any]:
    """Return the value if it is a list that is not empty."""
    if not isinstance(value, list) or not value:
        raise InvalidInput(where, repr(value)[:60], "a list that is not empty")
    return value


def check_known(name: Any, group: str, kind: str) -> str:
    """Return a name that can be used, the file of a plug-in as its absolute path, without running any code."""
    return check_name(group, name, kind)


def check_different(values: list[str], where: str, what: str) -> None:
    """Raise InvalidInput unless all values are different."""
    if len(set(values)) != len(values):
        raise InvalidInput(
            where, f"{what}s {values}", f"{'an' if what[0] in 'aeiou' else 'a'} {what} of its own for each"
        )


def all_of(data: Any, where: str, read: Callable[[Any], Item]) -> tuple[Item, ...]:
    """Read every item of an optional list."""
    return tuple(read(item) for item in check_list(data, where)) if data is not None else ()


def optional_count(value: Any, where: str) -> int | None:
    """Return an integer of at least 1, or None if the value is None."""
    if value is None:
        return None
    check_count(value, where, 1)
    return int(value)
