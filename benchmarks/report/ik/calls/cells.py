"""Cells and rows that the tables of single calls share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import polars as pl

from benchmarks.report.base import Column
from benchmarks.statistics import wilson

if TYPE_CHECKING:
    from benchmarks.blocks.ik.calls.rows import CallRows
    from benchmarks.report.base import Cell

LABEL = Column("label", "Method", show="text")
"""First column of every table."""


GIVEN = Column("given", "given as many problems as any", show="text", aside=True)
"""Whether a method was given as many problems as any: of the others no value is marked as the best of its column."""


def compared_columns(columns: Iterable[Column]) -> tuple[Column, ...]:
    """Columns in which the best is marked among the methods that were given the same problems."""
    return (*(replace(column, among=GIVEN.key) if column.better else column for column in columns), GIVEN)


def share_cell(count: int, trials: int) -> tuple[float, float, float]:
    """A share with Wilson's 95 % interval."""
    low, high = wilson(count, trials)
    return 100.0 * count / trials, 100.0 * low, 100.0 * high


def entry_rows(
    b: CallRows, first: str, cells: Callable[[str, pl.DataFrame], dict[str, Cell]]
) -> tuple[Mapping[str, Cell], ...]:
    """One row for each entry; of one that was not run, the word for why in place of a rate."""
    rows: list[Mapping[str, Cell]] = []
    most = max(map(len, b.by_method.values()), default=0)
    for label in b.entries:
        part = b.by_method.get(label)
        if part is None:
            rows.append({"label": label, first: b.why_not(label)[0]})
        else:
            rows.append({"label": label, GIVEN.key: "yes" if len(part) == most else ""} | cells(label, part))
    return tuple(rows)
