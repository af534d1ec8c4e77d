"""Entries of a block as a suite has them: methods, laws and peers, with their options and labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.blocks.base import Entry
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
    """Check the settings of an IK method of ours."""
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
    """Check the settings of a time law of ours."""
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
    """Check the settings of all peers of a block."""

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
    """Return the labels of some entries, all of them different."""
    labels = [entry.label for entry in entries]
    check_different(labels, where, "label")
    return labels
