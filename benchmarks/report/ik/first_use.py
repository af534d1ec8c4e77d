"""Piece of the section on speed: first use in fresh processes."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blocks.ik.first_use import MEASURES
from benchmarks.report.base import KindReport, Section
from benchmarks.report.ik.calls import SPEED
from benchmarks.report.run import Run
from benchmarks.report.tables import Cell, Column, Table
from benchmarks.targets import measure_named

FIRST_USE_COLUMNS = (
    Column("label", "Step", show="text"),
    Column("seconds", "median and range", "s", "less"),
    Column("count", "processes", show="count"),
)
"""Columns of the table."""


def _first_use(run: Run) -> dict[str, Any] | None:
    found = _tables(run)
    return {"tables": found} if found else None


def _tables(run: Run) -> list[Table]:
    """Return the seconds by measure: the median of all processes with their range."""
    rows: list[dict[str, Cell]] = []
    for b in run.of("first_use"):
        for (measure,), part in b.rows.group_by("method", maintain_order=True):
            seconds = part["seconds"].to_numpy()
            spread = (float(np.median(seconds)), float(seconds.min()), float(seconds.max()))
            what = measure_named(MEASURES, str(measure), "measure").title
            rows.append({"label": what, "seconds": spread, "count": len(part)})
    note = "Every value is from a separate process; the range is that of all processes."
    title = "First use in fresh processes"
    return [Table("speed-first-use", title, FIRST_USE_COLUMNS, tuple(rows), note)] if rows else []


REPORT = KindReport(
    (SPEED, Section("First use", "speed", _first_use, order=13)),
    lambda blocks: (),
    tables=_tables,
)
