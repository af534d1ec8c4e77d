"""Every table of a run that leaves the report: of its kinds, what failed, the winners, and what this project asked."""

from __future__ import annotations

import math
from typing import Any

from benchmarks.kinds._shown import Cell, Column, Table
from benchmarks.kinds._stored import tables as tables_of_rows
from benchmarks.kinds.base import Kind
from benchmarks.records import slug
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
"""Words of an outcome in a table that leaves the report."""


def all_tables(run: Run) -> list[Table]:
    """Every table, each id once."""
    found = [winners_table(run)]
    for kind in run.suite.kinds:
        found += kind.tables(run) or (() if kind.sections() else rows_tables(kind, run))
        found.append(failure_table(kind, run))
    found.append(asked_table(run))
    return list({table.id: table for table in found if table is not None}.values())


def rows_tables(kind: Kind, run: Run) -> list[Table]:
    """Entries by measures of every block, for a kind that has no tables of its own."""
    found = tables_of_rows(kind, run)
    return [_of_rows(kind, block, table) for block, table in found if table is not None and table["rows"]]


def _of_rows(kind: Kind, block: Any, table: dict[str, Any]) -> Table:
    columns = [Column("label", "Method", show="text")]
    rows: list[dict[str, Cell]] = [{"label": row["label"]} for row in table["rows"]]
    for k, head in enumerate(table["heads"]):
        several = max((len(row["values"][k]) for row in table["rows"]), default=1)
        share = head["show"] == "share" and several == 3
        for part in range(1 if share else several):
            key = head["name"] if part == 0 else f"{head['name']} {part + 1}"
            columns.append(Column(key, head["words"], head["unit"], show=head["show"]))
            for row, stored in zip(rows, table["rows"], strict=True):
                values = [float(v) for v in stored["values"][k]]
                row[key] = (values[0], values[1], values[2]) if share else values[part]
    return Table(f"{slug(kind.name)}-{slug(block.id)}", table["title"], tuple(columns), tuple(rows))


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
