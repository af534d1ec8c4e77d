"""Section on single calls: plots and tables of success and time, and who wins."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import polars as pl

from benchmarks.blocks._contest import version_words
from benchmarks.blocks.ik.calls import FIRST_ROUND_FROM, CallRows
from benchmarks.blocks.ik.judgement import shared
from benchmarks.report.base import KindReport, Section, Winner
from benchmarks.report.ik.calls_plots import against_singularity, errors, profiles, success_in_time
from benchmarks.report.ik.calls_tables import LABEL, block_tables
from benchmarks.report.ik.default import has_same_problems
from benchmarks.report.run import Run
from benchmarks.report.tables import Cell, Column, Table
from benchmarks.report.winners import most_solved, ranked
from benchmarks.statistics import median_interval, not_longer


def tables(run: Run) -> list[Table]:
    """Return the tables of all blocks, and one of the compared methods."""
    found: list[Table] = []
    for b in run.of("calls"):
        first, *others = block_tables(b)
        wider = [m.block.title for m in run.of("budgets") if has_same_problems(m.block, b.block)]
        if wider:
            words = f"The rates here are those of the timed calls; those of one attempt are in “{wider[0]}”."
            first = replace(first, note=f"{first.note} {words}")
        found += [first, *others]
    return [*found, _compared(run)] if found else []


def _compared(run: Run) -> Table:
    """Return every method and peer once, or several times if its settings differ between blocks."""
    found: dict[tuple[str, str], dict[str, Cell]] = {}
    for b in run.of("calls"):
        for label, about in b.entries.items():
            row = {"label": label, "version": version_words(about), "settings": about["settings"]}
            found.setdefault((label, about["settings"]), row)
    columns = (LABEL, *(Column(key, key, show="text") for key in ("version", "settings")))
    return Table("speed-compared", "Versions and settings", columns, tuple(found.values()))


# ---------------------------------------------------------------- who wins


def winners(run: Run) -> list[Winner]:
    """Answer two questions for each block that compares methods."""
    blocks = [b for b in run.of("calls") if len(b.by_method) > 1 and not b.unreachable]
    return [winner for b in blocks for winner in block_winners(b)]


def block_winners(b: CallRows) -> list[Winner]:
    """Return two winners: the method that solves most, and the fastest method not significantly different from it.

    Methods are compared on the problems that all of them were given, times on those that all of them solved as well.
    """
    who = ranked({label: len(part) for label, part in b.by_method.items()})
    rows = shared(b.rows, who.labels).sort("problem")
    if rows.is_empty():
        return []
    parts = {label: rows.filter(pl.col("method") == label) for label in who.labels}
    solved = {label: part["solved"].to_numpy() for label, part in parts.items()}
    note = f"{_problems(parts[who.labels[0]], b.facts['count'])}{who.left_out}"
    most = most_solved(f"Highest success rate: {b.block.title}", "speed", solved, note)
    fastest = _fastest(b, rows, most.tied)
    return [most] if fastest is None else [most, fastest]


def _fastest(b: CallRows, rows: pl.DataFrame, labels: tuple[str, ...]) -> Winner | None:
    """Return the shortest median time on the problems that all of some methods solved."""
    both = shared(rows.filter("solved"), labels)
    if len(labels) < 2 or both["method"].n_unique() < len(labels):
        return None
    us = {label: both.filter(pl.col("method") == label)["ns"].to_numpy() / 1e3 for label in labels}
    times = sorted(((label, *median_interval(x)) for label, x in us.items()), key=lambda entry: entry[1])
    return Winner(
        f"Fastest among equally successful methods: {b.block.title}", "µs", "less", tuple(times), "speed",
        f"median time of a call on the {both['problem'].n_unique():,} problems solved by all of them",
        "bootstrap 95 % intervals; differences by Wilcoxon's signed-rank test", not_longer(times[0][0], us),
        len(us[labels[0]]),
    )  # fmt: skip


def _problems(part: pl.DataFrame, count: int) -> str:
    """Describe the compared problems: how many of how many, and how many with a known solution."""
    words = f"the same {len(part):,}{f' of {count:,}' if len(part) < count else ''} problems for all"
    known = int(part["known"].sum())
    if known == len(part):
        return f"{words}, each with a known solution"
    return f"{words}, {known:,} of them with a known solution"


# ---------------------------------------------------------------- sections

TIMING_RULES = (
    "A call solves one target from one start. Its time includes the way from Python and back. It runs on one thread unless the "
    "method starts threads of its own. optik's forward kinematics judges every answer: solved means errors of at most 10⁻⁶ m "
    "and 10⁻⁶ rad with every joint inside its limits. If a peer returns several branches, one solution among them suffices; "
    "full turns are added where they bring a joint inside its limits. Slow methods are given fewer problems; a ratio of "
    "medians is computed on the problems that both methods were given. Building time includes the first import of a package."
)
"""Rules of timing and judging calls."""

LIMITATIONS_OF_CALLS = (
    "Calls are timed in a loop over different targets, with code and tables in the processor's caches. A single call "
    "after other work takes longer. The garbage collector is off during timing.",
    "Every round has the same problems. If the first call of a problem typically takes more than "
    f"{FIRST_ROUND_FROM:g} times the median of the method's calls of it (median over the problems), the method's time is "
    "that of its first round, and the note below the table names it.",
    "Closed-form peers compute every branch, our methods one solution near the start. A peer that starts threads is "
    "timed with them. Peers have the settings that served them best on the paper's arm; their rows state them.",
)
"""Limitations of the figures."""


def _success_plot(run: Run) -> dict[str, Any] | None:
    """Show success against time budget, for the first screen."""
    blocks = run.of("calls")
    return {"boards": [success_in_time(blocks, run)]} if blocks else None


def _calls(run: Run) -> dict[str, Any] | None:
    """Show performance profiles, errors and singular values, tables of every block, and the compared methods."""
    blocks = run.of("calls")
    if not blocks:
        return None
    boards = [profiles(blocks, run), errors(blocks, run), against_singularity(blocks, run)]
    return {"boards": [board for board in boards if board is not None], "tables": run.tables_of("calls")}


def _rules(run: Run) -> dict[str, Any]:
    """Show how calls are timed."""
    return {"how": "Timing of calls", "prose": [TIMING_RULES]}


SPEED = Section("Speed of one call", "speed", _rules, order=19)
"""The end of the section on speed; every kind in this section includes it."""

REPORT = KindReport(
    (
        Section("Success against time budget", "calls", _success_plot, order=11, place="top"),
        SPEED,
        Section("Speed of one call", "speed", _calls, order=11),
    ),
    lambda blocks: ("inverse kinematics, call by call",),
    winners=winners,
    tables=tables,
    limitations=lambda run: LIMITATIONS_OF_CALLS,
)
