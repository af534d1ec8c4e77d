"""Columns of a table: quantities of the rows of a block with their words, their unit and their computation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from benchmarks.statistics import median_interval, percentage, quantiles
from optik.types import Array

Cell = str | float | int | None | tuple[float, float, float]
"""A value of a table: text, a number, None if there is none, or a value with the ends of its interval."""

Of = Callable[[pl.DataFrame], Cell]
"""Computation of a value from the rows of a group, such as those of one method."""

Condition = str | pl.Expr
"""A column of truth values, or an expression."""

What = Condition | Callable[[pl.DataFrame], Array]
"""Numbers of the rows: a column, an expression, or a function of the rows."""


@dataclass(frozen=True)
class Column:
    """A quantity, as a column of a table or a measure that a target names: key, heading, look, and computation."""

    key: str
    words: str
    unit: str = ""
    """Of its values; empty for text, counts and ratios."""
    better: str = ""
    """``more`` or ``less``, where one value is better than another; else empty."""
    show: str = "number"
    """``number`` (three digits), ``precise`` (four), ``exact`` (seven), ``limit`` (a value over its limit: above 1 with
    enough digits to differ from 1), ``p`` (a p-value), ``count``, ``share`` (a percentage), ``text``, ``verdict`` (met or
    missed), or ``mixed``: what the row's ``show`` says, else a percentage where its ``unit`` is %, else a number."""
    aside: bool = False
    """Whether the page shows it only on request: for columns that few readers ask for."""
    among: str = ""
    """Key of a column that must not be empty for a row to be marked best; without a key, any row may be.
    A motion that exceeds a limit must not be called the shortest."""
    of: Callable[..., Any] | None = None
    """From the rows of a group to its value; None where the value is given. If `relative`, it also takes two labels."""
    relative: bool = False
    """Whether the value compares an entry with a second one, the ``to`` of a target."""

    @property
    def is_text(self) -> bool:
        """Whether its values are words, which stand at the left."""
        return self.show in ("text", "verdict")

    def value(self, rows: pl.DataFrame, *labels: str) -> float:
        """Return the computed value as a number, without its interval; NaN if there is none."""
        found = None if self.of is None else self.of(rows, *labels)
        first = found[0] if isinstance(found, tuple) else found
        return float("nan") if first is None else float(first)

    @property
    def head(self) -> str:
        """The heading with the unit."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words


# ---------------------------------------------------------------- computations


def values_of(rows: pl.DataFrame, what: What) -> Array:
    """Return the numbers of a column or an expression, without those that are missing."""
    if callable(what):
        return what(rows)
    return rows.select(what).to_series().drop_nulls().cast(pl.Float64).to_numpy()


def count_of(rows: pl.DataFrame, what: Condition) -> int:
    """Return the number of rows at which a condition is true."""
    return int(rows.select(what).to_series().cast(pl.Boolean).sum())


def _statistic(compute: Callable[[Array], Any], what: What, scale: float, among: Condition | None) -> Of:
    def of(rows: pl.DataFrame) -> float | None:
        found = values_of(rows if among is None else rows.filter(among), what)
        return scale * float(compute(found)) if len(found) else None

    return of


def median(what: What, scale: float = 1.0, *, among: Condition | None = None) -> Of:
    """Return the computation of the median; of no values it is None."""
    return _statistic(np.median, what, scale, among)


def mean(what: What, scale: float = 1.0, *, among: Condition | None = None) -> Of:
    """Return the computation of the mean; of no values it is None."""
    return _statistic(np.mean, what, scale, among)


def largest(what: What, scale: float = 1.0, *, among: Condition | None = None) -> Of:
    """Return the computation of the largest value; of no values it is None."""
    return _statistic(np.max, what, scale, among)


def quantile(what: What, level: float, scale: float = 1.0, *, among: Condition | None = None) -> Of:
    """Return the computation of a quantile, which infinite values do not make NaN; of no values it is NaN."""

    def of(rows: pl.DataFrame) -> float:
        return scale * quantiles(values_of(rows if among is None else rows.filter(among), what), (level,))[0]

    return of


def median_with_interval(what: What) -> Of:
    """Return the computation of the median with its bootstrap interval."""
    return lambda rows: median_interval(values_of(rows, what))


def median_with_range(what: What) -> Of:
    """Return the computation of the median with the least and the largest value."""

    def of(rows: pl.DataFrame) -> tuple[float, float, float]:
        found = values_of(rows, what)
        return float(np.median(found)), float(found.min()), float(found.max())

    return of


def count(what: Condition) -> Of:
    """Return the computation of the number of rows at which a condition is true."""
    return lambda rows: count_of(rows, what)


def share(what: Condition, *, among: Condition | None = None) -> Of:
    """Return the computation of the percentage of rows at which a condition is true, with Wilson's interval."""

    def of(rows: pl.DataFrame) -> Cell:
        chosen = rows if among is None else rows.filter(among)
        return percentage(count_of(chosen, what), len(chosen)) if len(chosen) else None

    return of
