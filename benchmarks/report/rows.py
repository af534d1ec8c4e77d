"""The section of a kind that has none of its own: its targets, and a table of entries by measures for every block."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.kinds._stored import tables, why_stored
from benchmarks.kinds.base import Kind, Measure, Section
from benchmarks.records import slug
from benchmarks.report.run import Run
from benchmarks.report.tables import cells, target_row

TEMPLATE = Path(__file__).parent / "templates" / "rows.html.j2"
"""What shows the table."""


def section_of(kind: Kind) -> Section:
    """The section of a kind that has none of its own.

    Parameters
    ----------
    kind : Kind
        The kind.

    Returns
    -------
    Section
        A table for every block.
    """
    return Section(kind.title, slug(kind.name), lambda run: _build(kind, run), TEMPLATE)


def _build(kind: Kind, run: Run) -> dict[str, Any] | None:
    found = tables(kind, run)
    shown = [_table(block, table) for block, table in found if table is not None and table["rows"]]
    why = _why(kind, run, len(found) - len(shown))
    if not shown and not why:
        return None
    targets = [target_row(o) for o in run.outcomes if o.block in {block.id for block, _ in found}]
    return {"id": slug(kind.name), "why": why, "tables": shown, "targets": targets}


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


def _table(block: Any, table: dict[str, Any]) -> dict[str, Any]:
    measures = [Measure(h["name"], h["unit"], len, h["words"], show=h["show"]) for h in table["heads"]]
    rows = []
    for row in table["rows"]:
        shown = [cells(m, [float(v) for v in values]) for m, values in zip(measures, row["values"], strict=True)]
        rows.append({"label": row["label"], "cells": shown})
    return {"id": block.id, "title": table["title"], "first": "Method", "heads": table["heads"], "rows": rows}
