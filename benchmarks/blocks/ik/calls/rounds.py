"""Rounds of a block of single calls: a method that remembers answers is timed by its first round."""

from __future__ import annotations

import polars as pl

REMEMBERS_FROM = 3.0
"""A first round this many times as slow as the median of all rounds: the method may remember answers, or compile late."""


def without_memory(rows: pl.DataFrame) -> pl.DataFrame:
    """Rows in which a method whose later rounds are far faster than its first is timed by its first round.

    Every round has the same problems, so a method that remembers its answers has to compute in the first only.
    """
    if "first_ns" not in rows.columns:
        return rows
    first, typical = (pl.col(name).median().over("method") for name in ("first_ns", "ns"))
    by_first = (first > REMEMBERS_FROM * typical).fill_null(value=False)
    ns = pl.when(by_first).then(pl.col("first_ns").cast(pl.Float64)).otherwise(pl.col("ns"))
    return rows.with_columns(first_round=(first / typical).fill_null(float("nan")), ns=ns)  # none: all calls crashed
