"""Section: seams as whole paths and one way: their measures, and each published seam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.seams import METHOD
from benchmarks.records import slug
from benchmarks.report.base import Run, plain_report
from benchmarks.report.tables import Column, Table

COLUMNS = (
    Column("seam", "Seam", show="text"), Column("method", "method", show="text"), Column("status", "status", show="text"),
    Column("length", "length", "m"), Column("duration", "duration", "s"),
    Column("reconfigurations", "reconfigurations", show="count"), Column("ms", "CPU time", "ms"),
    Column("reason", "reason", show="text", aside=True),
)  # fmt: skip
"""Columns of the list of published seams."""
MEASURED = plain_report(METHOD())
"""The report of the measures."""


def tables(run: Run) -> Sequence[Table]:
    """Return for each block its measures, and a list of its published seams."""
    found: list[Table] = []
    for b, measured in zip(run.of("seams"), MEASURED.tables(run), strict=True):
        found += [measured, _list_seams(b)] if b.block.files else [measured]
    return found


def _list_seams(b: BlockRows) -> Table:
    rows = b.rows.select(column.key for column in COLUMNS).to_dicts()
    return Table(f"seams-each-{slug(b.block.id)}", f"Each seam: {b.block.title}", COLUMNS, tuple(rows))


REPORT = replace(MEASURED, tables=tables)
