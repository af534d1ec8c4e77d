"""Formatted tables: digits for publication, the best values marked, and columns shown on request."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from benchmarks.report.base import Cell, Column, Table
from benchmarks.report.figures import noise_floor
from benchmarks.report.numbers import number, p_value, ratio

if TYPE_CHECKING:
    from benchmarks.report.run import Run

FIRST = "label"
"""Key of the first column, of a method or law; the row has its colour."""

LEAST_DIGITS, MOST_DIGITS = 2, 4
"""Significant digits of a value with an interval."""

DECIMALS_OF_SHARES = 3
"""Most decimals of a percentage."""


@dataclass(frozen=True)
class ShownCell:
    """One cell: its text, its interval, its exact value, and whether no value of its column is significantly better."""

    text: str
    interval: str = ""
    value: float | None = None
    best: bool = False


@dataclass(frozen=True)
class ShownRow:
    """One row: its cells, and the colour of its method; empty if it belongs to no method."""

    cells: tuple[ShownCell, ...]
    colour: str = ""
    symbol: str = ""


@dataclass(frozen=True)
class ShownTable:
    """A table with its cells as text, for the page, Markdown and LaTeX."""

    table: Table
    rows: tuple[ShownRow, ...]

    @property
    def aside(self) -> bool:
        """Whether some columns are shown only on request."""
        return any(column.aside for column in self.table.columns)


def shown_table(table: Table, run: Run | None = None) -> ShownTable:
    """Return a table with its cells as text."""
    best = {column.key: _best(column, table.rows) for column in table.columns}
    rows = []
    for k, row in enumerate(table.rows):
        columns = [_own(column, row) for column in table.columns]
        cells = tuple(shown_cell(column, row.get(column.key), k in best[column.key]) for column in columns)
        label = str(row.get(FIRST, ""))
        if run is not None and label in run.labels:
            rows.append(ShownRow(cells, run.colour(label), run.symbol(label)))
        else:
            rows.append(ShownRow(cells))
    return ShownTable(table, tuple(rows))


def _own(column: Column, row: Mapping[str, Cell]) -> Column:
    """Return a column with the unit of a row that has a separate one."""
    if column.show != "mixed":
        return column
    unit = str(row.get("unit") or "")
    return replace(column, unit=unit, show="share" if unit == "%" else "number")


def shown_cell(column: Column, value: Cell, best: bool = False) -> ShownCell:
    """Return a cell as text."""
    if isinstance(value, str):
        return ShownCell(value)
    if value is None:
        return ShownCell("–")
    middle, low, high = value if isinstance(value, tuple) else (value, math.nan, math.nan)
    if math.isnan(middle):
        return ShownCell("–")
    floor = noise_floor(column.unit)
    if floor and abs(middle) < floor:
        return ShownCell(f"≤ {number(floor, 1).replace('1·', '')}", "", float(middle), best)
    text, interval = written(column.show, float(middle), low, high)
    return ShownCell(text, interval, float(middle), best)


def written(show: str, middle: float, low: float = math.nan, high: float = math.nan) -> tuple[str, str]:
    """Format a value and its interval with their significant digits."""
    if low == middle == high:
        low = high = math.nan  # an exact value
    half = (high - low) / 2
    if show == "share":
        decimals = 1 if not half > 0 else min(max(-math.floor(math.log10(half)), 1), DECIMALS_OF_SHARES)
        step = 10.0**-decimals
        text = "100" if middle >= 100 else f"{min(middle, 100 - step):.{decimals}f}"  # 100 means all
        return text, "" if math.isnan(half) else f"{low:.{decimals}f} to {high:.{decimals}f}"
    if show == "p":
        return p_value(middle), ""
    if show == "count":
        return (f"{middle:,.0f}" if middle == round(middle) else number(middle)), _interval(low, high, 3)
    if show == "limit":
        return ratio(middle), ""
    if show == "exact" and math.isfinite(middle):
        return f"{middle:.7g}", "" if math.isnan(half) else f"{low:.7g} to {high:.7g}"
    digits = 4 if show == "precise" else 3
    if half > 0 and math.isfinite(half) and middle:
        digits = 1 + math.floor(math.log10(abs(middle))) - math.floor(math.log10(half))
        digits = min(max(digits, LEAST_DIGITS), MOST_DIGITS)
    return number(middle, digits), _interval(low, high, digits)


def _interval(low: float, high: float, digits: int) -> str:
    if math.isnan(low) or math.isnan(high) or math.isinf(low):
        return ""
    return f"{number(low, digits)} to {number(high, digits)}"


def _best(column: Column, rows: Sequence[Mapping[str, Cell]]) -> set[int]:
    """Return the rows with the best value of a column and with overlapping intervals; empty if these are all rows.

    Told apart are two values of which neither is inside the other's interval: that is less than intervals without
    overlap, which small samples hardly ever have.
    """
    if not column.better:
        return set()
    found = {k: _ends(row.get(column.key)) for k, row in enumerate(rows) if not column.among or row.get(column.among)}
    known = {k: ends for k, ends in found.items() if math.isfinite(ends[0])}
    if len(known) < 2:
        return set()
    pick = max if column.better == "more" else min
    best, low, high = pick(known.values(), key=lambda ends: ends[0])
    level = {k for k, (value, a, b) in known.items() if low <= value <= high or a <= best <= b}
    return level if len(level) < len(known) else set()


def _ends(cell: Cell) -> tuple[float, float, float]:
    """Return a value with the ends of its interval: itself if it has none; NaN if it is no number."""
    if isinstance(cell, tuple):
        middle, low, high = (float(v) for v in cell)
        return middle, middle if math.isnan(low) else low, middle if math.isnan(high) else high
    value = float(cell) if isinstance(cell, float | int) else math.nan
    return value, value, value
