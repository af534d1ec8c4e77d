"""Section: how fast and how sure one call is, of our methods and of peers; plots first, tables after."""

from __future__ import annotations

from typing import Any

from benchmarks.blocks._contest import version_words
from benchmarks.report.base import Column, Table
from benchmarks.report.ik.calls.plots import against_singularity, errors, profiles, success_in_time
from benchmarks.report.run import Run


def success_plot(run: Run) -> dict[str, Any] | None:
    """Success against time budget, for the first screen."""
    blocks = run.of("calls")
    return {"boards": [success_in_time(blocks, run)], "tables": []} if blocks else None


def calls(run: Run) -> dict[str, Any] | None:
    """Performance profiles, tables of every block, errors and singular values, and what was compared."""
    blocks = run.of("calls")
    if not blocks:
        return None
    boards = [profiles(blocks, run), errors(blocks, run), against_singularity(blocks, run)]
    return {"boards": [board for board in boards if board is not None], "tables": all_tables(run)}


def all_tables(run: Run) -> list[Table]:
    """Tables of all blocks, and one of what was compared."""
    blocks = run.of("calls")
    return [table for b in blocks for table in b.tables] + ([compared(run)] if blocks else [])


def compared(run: Run) -> Table:
    """Every method and peer once, and again where its settings differ between blocks."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for b in run.of("calls"):
        for label, about in b.entries.items():
            row = {"label": label, "version": version_words(about), "settings": about["settings"]}
            found.setdefault((label, about["settings"]), row)
    columns = (
        Column("label", "Method", show="text"),
        Column("version", "version", show="text"),
        Column("settings", "settings", show="text"),
    )
    title = "Versions and settings"
    return Table("speed-compared", title, columns, tuple(found.values()))
