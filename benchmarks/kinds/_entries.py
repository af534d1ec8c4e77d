"""Entries of a block as a suite has them: methods, laws and peers, with their options and labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.kinds.base import Entry
from benchmarks.settings import (
    all_of,
    check_different,
    check_keys,
    check_known,
    check_list,
    check_table,
    optional_count,
)
from optik.errors import InvalidInput
from optik.registry import short_name
from planners.limits import ALL_LIMITS


def read_method(data: Any, where: str) -> Entry:
    """Check the settings of an IK method of ours.

    Parameters
    ----------
    data : object
        A table with ``solver``, and perhaps ``label``, ``options`` and ``max_problems``.
    where : str
        Which block, for errors.

    Returns
    -------
    Entry
        The method.

    Raises
    ------
    InvalidInput
        A wrong key or value.
    UnknownName
        No such method.
    """
    check_keys(data, {"label", "solver", "options", "max_problems"}, f"{where}: methods", need={"solver"})
    name = check_known(data["solver"], "optik.ik", "IK method")
    most = optional_count(data.get("max_problems"), f"{where}: max_problems")
    return Entry(
        str(data.get("label", short_name(name))),
        name,
        dict(check_table(data.get("options", {}), f"{where}: options")),
        most,
    )


def read_law(data: Any, where: str, role: str = "law") -> Entry:
    """Check the settings of a time law of ours.

    Parameters
    ----------
    data : object
        A table with ``law``, and perhaps ``label``, ``options`` and ``without``.
    where : str
        Which block and key, for errors.
    role : str
        ``law`` or ``reference``.

    Returns
    -------
    Entry
        The law.

    Raises
    ------
    InvalidInput
        A wrong key or value.
    UnknownName
        No such law.
    """
    check_keys(data, {"label", "law", "options", "without"}, where, need={"law"})
    name = check_known(data["law"], "planners.timing", "time law")
    without = tuple(check_list(data["without"], f"{where}: without")) if "without" in data else ()
    if unknown := [limit for limit in without if limit not in ALL_LIMITS]:
        raise InvalidInput(f"{where}: without", repr(unknown[0])[:60], f"limits out of {', '.join(ALL_LIMITS)}")
    return Entry(
        str(data.get("label", short_name(name))),
        name,
        dict(check_table(data.get("options", {}), f"{where}: options")),
        role=role,
        without=without,
    )


def read_peers(
    data: Any, where: str, folder: str, *, word: str = "peer", most: str = "max_problems", budgets: bool = False
) -> tuple[Entry, ...]:
    """Check the settings of all peers of a block.

    Parameters
    ----------
    data : object
        A list of tables with ``peer``, and perhaps ``label`` and the key `most`; None for no peers.
    where : str
        Which block, for errors.
    folder : str
        The package in which they are found by their names.
    word : str
        What errors call them.
    most : str
        The key that says how many problems or lines a slow one is given.
    budgets : bool
        Whether a peer may have the key ``iterations``, the largest number of iterations of a call.

    Returns
    -------
    tuple of Entry
        The peers.

    Raises
    ------
    InvalidInput
        A wrong key or value.
    UnknownName
        No such peer.
    """

    def read(peer: Any) -> Entry:
        check_keys(
            peer, {"label", "peer", most, *(["iterations"] if budgets else [])}, f"{where}: peers", need={"peer"}
        )
        name = check_known(peer["peer"], folder, word)
        shown = str(peer.get("label", short_name(name).replace("_", " ")))
        budget = optional_count(peer.get("iterations"), f"{where}: iterations")
        options = {} if budget is None else {"iterations": budget}
        return Entry(shown, name, options, optional_count(peer.get(most), f"{where}: {most}"), "peer")

    return all_of(data, f"{where}: peers", read)


def _options(data: dict[str, Any], where: str) -> dict[str, Any]:
    """Options of an entry: a copy of its table."""
    return dict(check_table(data.get("options", {}), f"{where}: options"))


def check_labels(entries: Sequence[Entry], where: str) -> list[str]:
    """Return the labels of some entries, all of them different.

    Parameters
    ----------
    entries : sequence of Entry
        Of one block.
    where : str
        Which block and key, for errors.

    Returns
    -------
    list of str
        The labels.

    Raises
    ------
    InvalidInput
        A label that two entries have.
    """
    labels = [entry.label for entry in entries]
    check_different(labels, where, "label")
    return labels
