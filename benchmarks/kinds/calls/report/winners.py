"""Who wins on a block of single calls: most targets solved; shortest time among those that solve as many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import polars as pl

from benchmarks.kinds.base import Winner
from benchmarks.kinds.calls.measures import shared
from benchmarks.kinds.calls.report.cells import share_cell
from benchmarks.kinds.calls.rows import CallRows
from benchmarks.report.run import Run
from benchmarks.statistics import median_interval, not_beaten


def winners(run: Run) -> Sequence[Winner]:
    """Two questions for each block that compares methods.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    sequence of Winner
        In the order of the suite.
    """
    blocks = [b for b in run.of("calls") if len(b.by_method) > 1 and not b.unreachable]
    return [winner for b in blocks for winner in block_winners(b)]


def block_winners(b: CallRows) -> list[Winner]:
    """Who solves most, and who is fastest among those whose share none surely beats.

    Where a solution is not known of every problem, all are compared on the problems that all were given: slow methods are
    given those with a known solution first.

    Parameters
    ----------
    b : CallRows
        The block.

    Returns
    -------
    list of Winner
        The second is left out where one method alone solves most.
    """
    rows = b.rows if b.rows["known"].all() else shared(b.rows, tuple(b.by_method))
    parts = {label: part for label in b.by_method if len(part := rows.filter(rows["method"] == label))}
    if not parts:
        return []
    note = _numbers_of(parts, b.facts["count"])
    solved = [(label, *share_cell(int(part["solved"].sum()), len(part))) for label, part in parts.items()]
    solved.sort(key=lambda e: (-e[1], -e[2]))
    level = not_beaten(
        solved[0][0], {label: dict(part.select("problem", "solved").iter_rows()) for label, part in parts.items()}
    )
    most = Winner(
        f"Solves the most targets: {b.block.title}", "%", "more", tuple(solved), "speed",
        f"{note}; Wilson 95 % intervals, ties by McNemar's test on shared problems", level,
    )  # fmt: skip
    times = [(label, *median_interval(parts[label]["ns"].to_numpy() / 1e3)) for label in most.tied]
    if len(times) < 2:
        return [most]
    fastest = Winner(
        f"Fastest of those that solve as many: {b.block.title}", "µs", "less", tuple(sorted(times, key=lambda e: e[1])),
        "speed", f"median time of a call, all calls; {note}; bootstrap intervals",
    )  # fmt: skip
    return [most, fastest]


def _numbers_of(parts: Mapping[str, pl.DataFrame], count: int) -> str:
    """How many problems there are, and how many the methods were given where that is fewer."""
    given: dict[int, list[str]] = {}
    for label, part in parts.items():
        given.setdefault(len(part), []).append(label)
    if len(given) == 1:
        (only,) = given
        return f"{count:,} problems" if only == count else f"{only:,} of {count:,} problems"
    most = max(given, key=lambda number: len(given[number]))
    few = ", ".join(f"{number:,} for {', '.join(labels)}" for number, labels in given.items() if number != most)
    return f"{count:,} problems: {most:,} for {'most' if len(given[most]) > 1 else given[most][0]}, {few}"
