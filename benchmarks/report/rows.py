"""The section of a kind that has none of its own: a table of entries by measures for every block."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.kinds._stored import why_stored
from benchmarks.kinds.base import Kind, Section
from benchmarks.records import slug
from benchmarks.report.run import Run
from benchmarks.report.takeout import rows_tables

TEMPLATE = Path(__file__).parent / "templates" / "rows.html.j2"
"""What shows the table."""


def section_of(kind: Kind) -> Section:
    """The section of a kind that has none of its own."""
    return Section(kind.title, slug(kind.name), lambda run: _build(kind, run), TEMPLATE)


def _build(kind: Kind, run: Run) -> dict[str, Any] | None:
    shown = rows_tables(kind, run)
    why = _why(kind, run, len(run.suite.of(kind.name)) - len(shown))
    return {"why": why, "tables": shown} if shown or why else None


def _why(kind: Kind, run: Run, lacking: int) -> str:
    """Why there is a table and no more, where the code of the kind is not here."""
    why = why_stored(kind)
    if not why:
        return ""
    words = f"The kind of block {kind.name!r} is not available here: {why}."
    if not lacking:
        return f"{words} The figures below were computed at the end of the run."
    return (
        f"{words} Figures are computed at the end of a run; rows of the blocks without figures are in {kind.folder}/."
    )
