"""Every table of a run for other formats: tables of its kinds, failures, winners, and acceptance targets."""

from __future__ import annotations

import math

from benchmarks.report.base import Cell, Column, Table
from benchmarks.report.failures import failure_table
from benchmarks.report.run import Run
from benchmarks.report.winners import winners_table

ASKED_COLUMNS = (
    Column("label", "What", show="text"),
    Column("where", "On", show="text"),
    Column("value", "Measured"),
    Column("asked", "Asked", show="text"),
    Column("unit", "Unit", show="text"),
    Column("held", "Held", show="text"),
    Column("note", "From", show="text"),
)
"""Columns of the table of targets."""

HELD_WORDS = {True: "yes", False: "no", None: "not measured"}
"""Words of an outcome in a table for other formats."""


def all_tables(run: Run) -> list[Table]:
    """Return every table, each id once."""
    found = [winners_table(run)]
    for kind in run.suite.kinds:
        found += run.tables_of(kind.name)
        found.append(failure_table(kind, run))
    found.append(asked_table(run))
    return list({table.id: table for table in found if table is not None}.values())


def asked_table(run: Run) -> Table | None:
    """Return every acceptance target of the suite with its outcome."""
    rows: list[dict[str, Cell]] = [
        {
            "label": o.what, "where": o.where, "value": None if math.isnan(o.value) else o.value, "asked": o.asked,
            "unit": o.unit, "held": HELD_WORDS[o.held] + (" (a goal)" if o.target.goal else ""), "note": o.note,
        }
        for o in run.outcomes
    ]  # fmt: skip
    return Table("asked", "Acceptance targets", ASKED_COLUMNS, tuple(rows)) if rows else None
