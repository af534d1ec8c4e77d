"""Piece of the section on speed: first use in fresh processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.blocks.ik.first_use.measures import MEASURES
from benchmarks.report.base import Column, KindReport, Section, Table
from benchmarks.report.ik.speed import SPEED
from benchmarks.report.run import Run
from benchmarks.targets import measure_named

if TYPE_CHECKING:
    from benchmarks.report.base import Cell

FIRST_USE_COLUMNS = (
    Column("label", "Step", show="text"),
    Column("seconds", "median and range", "s", "less"),
    Column("count", "processes", show="count"),
)
"""Columns of the table."""


def first_use(run: Run) -> dict[str, Any] | None:
    """The table of first use."""
    found = tables(run)
    return {"tables": found} if found else None


def tables(run: Run) -> Sequence[Table]:
    """Seconds by measure: the median of all processes with their range."""
    rows: list[Mapping[str, Cell]] = []
    for b in run.of("first_use"):
        for (measure,), part in b.rows.group_by("measure", maintain_order=True):
            seconds = part["seconds"].to_numpy()
            spread = (float(np.median(seconds)), float(seconds.min()), float(seconds.max()))
            what = measure_named(MEASURES, str(measure), "measure").title
            rows.append({"label": what, "seconds": spread, "count": len(part)})
    note = "Every value is from a separate process; the range is that of all processes."
    return (
        [Table("speed-first-use", "First use in fresh processes", FIRST_USE_COLUMNS, tuple(rows), note)] if rows else []
    )


SECTIONS = (
    SPEED,
    Section("First use", "speed", first_use, Path(__file__).with_name("first_use.html.j2"), 13),
)
"""A table, after what it shares with single calls and batches."""

REPORT = KindReport(
    SECTIONS,
    lambda blocks: (),
    tables=tables,
)
