"""Piece of the section on speed: first use in fresh processes."""

from __future__ import annotations

from typing import Any

from benchmarks.blocks.base import measure_named
from benchmarks.blocks.columns import median_with_range
from benchmarks.blocks.ik.first_use import MEASURES
from benchmarks.report.base import KindReport, Run, Section
from benchmarks.report.ik.calls import SPEED
from benchmarks.report.tables import Column, Table, table_of

FIRST_USE_COLUMNS = (
    Column("label", "Step", show="text"),
    Column("seconds", "median and range", "s", "less", of=median_with_range("seconds")),
    Column("count", "processes", show="count", of=len),
)
"""Columns of the table."""


def _first_use(run: Run) -> dict[str, Any] | None:
    found = _tables(run)
    return {"tables": found} if found else None


def _tables(run: Run) -> list[Table]:
    """Return the seconds by measure: the median of all processes with their range."""
    groups = [
        ({"label": measure_named(MEASURES, str(measure), "measure").words}, part)
        for b in run.of("first_use")
        for (measure,), part in b.rows.group_by("method", maintain_order=True)
    ]
    note = "Every value is from a separate process; the range is that of all processes."
    title = "First use in fresh processes"
    return [table_of("speed-first-use", title, FIRST_USE_COLUMNS, groups, note)] if groups else []


REPORT = KindReport(
    (SPEED, Section("First use", "speed", _first_use, order=13)),
    lambda blocks: (),
    tables=_tables,
)
