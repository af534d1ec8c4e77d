"""Settings that people wrote: tables, lists, names, numbers and targets, each checked and named where it is wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.registry import check_name

Item = TypeVar("Item")


@dataclass(frozen=True)
class Target:
    """What a block must show.

    Attributes
    ----------
    measure : str
        One of the block's measures; its last part is the unit.
    method : str
        Label of the method or law it is asked of; empty where the block has only one.
    to : str
        Label of the method or peer that ``median_ratio`` divides by.
    group : str
        The part of the problems it is asked of: a kind of line or a robot; empty for all.
    at_most, at_least : float or None
        The one that is given is the bound.
    goal : bool
        Whether it is only hoped for.
    """

    measure: str
    method: str = ""
    to: str = ""
    group: str = ""
    at_most: float | None = None
    at_least: float | None = None
    goal: bool = False


def bounds(data: dict[str, Any], where: str) -> dict[str, Any]:
    """The bound of a target, and whether it is only a goal."""
    if ("at_most" in data) == ("at_least" in data):
        others = sorted(set(data) - {"measure"})
        raise InvalidInput(where, f"{data['measure']} with {others}", "either at_most or at_least")
    found: dict[str, Any] = {
        key: check_number(data[key], f"{where}: {key}", "a number") for key in ("at_most", "at_least") if key in data
    }
    if not isinstance(data.get("goal", False), bool):
        raise InvalidInput(f"{where}: goal", repr(data["goal"])[:60], "true or false")
    return found | {"goal": data.get("goal", False)}


def check_keys(data: Any, known: set[str], where: str, need: set[str] | None = None) -> None:
    """Refuse what is no table, has a key that nobody reads, or lacks one that is needed."""
    if not isinstance(data, dict):
        raise InvalidInput(where, type(data).__name__, "a table")
    if unknown := sorted(set(data) - known):
        raise InvalidInput(where, f"the key {unknown[0]!r}", f"keys out of {', '.join(sorted(known))}")
    if missing := sorted((need or set()) - set(data)):
        raise InvalidInput(where, f"no {missing[0]!r}", f"the keys {', '.join(sorted(need or set()))}")


def check_list(value: Any, where: str) -> list[Any]:
    """Return a list that is not empty."""
    if not isinstance(value, list) or not value:
        raise InvalidInput(where, repr(value)[:60], "a list that is not empty")
    return value


def check_known(name: Any, group: str, kind: str) -> str:
    """Return a name that can be used, a plug-in's file as its absolute path, without running any code.

    Parameters
    ----------
    name : str
        A name of ours, of an entry point, or the path of a file.
    group : str
        Dotted name of the group, such as ``"optik.ik"``.
    kind : str
        What it should be, for messages.

    Returns
    -------
    str
        As `optik.registry.check_name`.

    Raises
    ------
    UnknownName
        No such name; the nearest are offered.
    InvalidInput
        No text, no such file, or a plug-in with a name that is taken.
    """
    return check_name(group, name, kind)


def check_different(values: list[str], where: str, what: str) -> None:
    """Refuse the same word twice."""
    if len(set(values)) != len(values):
        raise InvalidInput(
            where, f"{what}s {values}", f"{'an' if what[0] in 'aeiou' else 'a'} {what} of its own for each"
        )


def all_of(data: Any, where: str, read: Callable[[Any], Item]) -> tuple[Item, ...]:
    """Read every table of a list; none where there is no such list."""
    return tuple(read(item) for item in check_list(data, where)) if data is not None else ()


def optional_count(value: Any, where: str) -> int | None:
    """Return a whole number of at least 1, or None where none is given."""
    if value is None:
        return None
    check_count(value, where, 1)
    return int(value)
