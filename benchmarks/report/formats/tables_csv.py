"""Every table of a run as CSV: exact values; the ends of an interval have separate columns."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from benchmarks.records import RunFolder, slug
from benchmarks.report.base import Cell, Column, Table
from benchmarks.report.run import Run
from benchmarks.report.takeout import all_tables
from optik.plugins.files import forbid_code

TABLES_FOLDER = "tables"
"""Folder in the run folder with tables in other formats."""


@forbid_code()
def write_csv(folder: RunFolder) -> list[Path]:
    """Write ``tables/ID.csv`` for every table of a run."""
    return [write_table(folder, table.id, "csv", csv_of(table)) for table in all_tables(Run(folder))]


def write_table(folder: RunFolder, name: str, ending: str, text: str) -> Path:
    """Write one table into the run folder."""
    file = f"{TABLES_FOLDER}/{slug(name)}.{ending}"
    folder.write_text(file, text)
    return folder.path / file


def csv_of(table: Table) -> str:
    """Return a table as CSV with all its columns, in their order."""
    wide = {column.key for column in table.columns if any(isinstance(r.get(column.key), tuple) for r in table.rows)}
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([name for column in table.columns for name in _heads(column, column.key in wide)])
    for row in table.rows:
        writer.writerow([value for column in table.columns for value in _values(row, column.key, column.key in wide)])
    return out.getvalue()


def _heads(column: Column, wide: bool) -> list[str]:
    unit = f" [{column.unit}]" if column.unit else ""
    names = [column.key, f"{column.key} low", f"{column.key} high"] if wide else [column.key]
    return [name + unit for name in names]


def _values(row: Mapping[str, Cell], key: str, wide: bool) -> list[str]:
    cell = row.get(key)
    if not wide:
        return [_exact(cell)]
    return [_exact(v) for v in cell] if isinstance(cell, tuple) else [_exact(cell), "", ""]


def _exact(value: Cell) -> str:
    """Return a value with all its digits; NaN is written as in programs."""
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, tuple):
        value = value[0]
    return "NaN" if value != value else repr(value if isinstance(value, int) else float(value))
