"""Measures of judgements on contact: each on the rows of one method."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import polars as pl

from benchmarks.targets import Measure


def _share(says: str) -> Callable[[pl.DataFrame], float]:
    return lambda rows: 100.0 * float((rows["says"] == says).to_numpy().mean())


def _quantile(share: float) -> Callable[[pl.DataFrame], float]:
    return lambda rows: float(np.quantile(rows["ms"].to_numpy(), share))


def _count(column: str) -> Callable[[pl.DataFrame], float]:
    return lambda rows: float(rows[column].sum())


def _per_second(rows: pl.DataFrame) -> float:
    return float(np.median(rows["ms"].to_numpy() / rows["duration"].to_numpy()))


MEASURES = (
    Measure("free", "%", _share("free"), "judged free"),
    Measure("undecided", "%", _share("undecided"), "undecided"),
    Measure("missed", "", _count("missed"), "missed contacts", show="count"),
    Measure("false_contacts", "", _count("false_contact"), "false contacts", show="count"),
    Measure("median_ms", "ms", _quantile(0.5), "median time of a motion"),
    Measure("p99_ms", "ms", _quantile(0.99), "99th percentile of the time"),
    Measure("median_ms_per_s", "ms/s", _per_second, "median time per second of motion"),
)
"""What a target of such a block may ask for."""
