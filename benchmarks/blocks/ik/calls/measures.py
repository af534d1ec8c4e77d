"""Measures of single calls: computed on the rows of one method, or of two on the problems that both were given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.ik.calls.judgement import JUDGED_AT, level_name, solved_at
from benchmarks.statistics import shifted_geometric_mean
from benchmarks.targets import Measure, Target, measure_named

SHIFT_US = 10.0
"""Shift of the shifted geometric mean of times [µs]: differences far below it do not decide the mean."""


def shared(rows: pl.DataFrame, labels: tuple[str, ...]) -> pl.DataFrame:
    """Rows of some methods on the problems that all of them were given."""
    chosen = rows.filter(pl.col("method").is_in(labels))
    return chosen.filter(pl.col("method").n_unique().over("problem") == chosen["method"].n_unique())


def median_ratio(rows: pl.DataFrame, method: str, to: str) -> float:
    """Median time of all calls of one method over that of another, on the problems that both were given.

    A target asks for it; tables show the ratio on the problems that both solved (`ratio_where_solved`).
    """
    both = shared(rows, (method, to))
    mine, other = (both.filter(pl.col("method") == label)["ns"].to_numpy() for label in (method, to))
    return float(np.median(mine) / np.median(other)) if len(mine) and len(other) else float("nan")


def ratio_where_solved(rows: pl.DataFrame, method: str, to: str) -> float:
    """Median time of one method over that of another, on the problems that both were given and both solved."""
    return median_ratio(rows.filter("solved"), method, to)


def _solved(rows: pl.DataFrame) -> float:
    return 100.0 * int(rows["solved"].sum()) / len(rows)


def _solved_at(tolerance: float) -> Callable[[pl.DataFrame], float]:
    """Share solved at a tolerance [%]; failures and missing answers count among the problems."""
    return lambda rows: 100.0 * int(rows.select(solved_at(tolerance).sum()).item()) / len(rows)


def _us(statistic: Callable[[Any], Any]) -> Callable[[pl.DataFrame], float]:
    """A statistic of the times of calls [µs]."""
    return lambda rows: float(statistic(rows["ns"].to_numpy() / 1e3))


MEASURES = (
    Measure("success", "%", _solved, "solved", show="exact"),
    *(
        Measure(
            f"success_{level_name(at)}", "%", _solved_at(at), f"solved within {level_name(at)} m and rad", show="exact"
        )
        for at in JUDGED_AT
    ),
    Measure("median_us", "µs", _us(np.median), "median time of a call"),
    Measure("mean_us", "µs", _us(np.mean), "mean time of a call"),
    Measure("p90_us", "µs", _us(lambda us: np.quantile(us, 0.90)), "90th percentile of a call"),
    Measure("p99_us", "µs", _us(lambda us: np.quantile(us, 0.99)), "99th percentile of a call"),
    Measure(
        "sgm_us", "µs", _us(lambda us: shifted_geometric_mean(us, SHIFT_US)), "shifted geometric mean time of a call"
    ),
    Measure("max_us", "µs", _us(np.max), "longest call"),
    Measure("median_ratio", "", median_ratio, "median time of all calls, as a ratio to", relative=True),
)
"""What a target of single calls may ask for."""


def judge(rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
    """Value of a target on the rows of a block."""
    measure = measure_named(MEASURES, target.measure, "measure")
    wanted = (target.method, target.to) if target.to else (target.method,)
    for label in wanted:
        if rows is None or rows.filter(pl.col("method") == label).is_empty():
            return float("nan"), f"{label} was not run"
    assert rows is not None
    chosen = shared(rows, wanted)
    if measure.relative:
        count = chosen["problem"].n_unique()
        return float(measure.compute(chosen, *wanted)), f"{count:,} problems, both"
    note = f"{len(chosen):,} calls"
    if target.measure == "success":
        note += f", {len(chosen) - int(chosen['solved'].sum()):,} not solved"
    return measure.values(chosen)[0], note
