"""Measures of a batch: on the rows of its largest number of threads."""

from __future__ import annotations

import numpy as np
import polars as pl

from benchmarks.targets import Measure, Target, measure_named


def solved_rate(rows: pl.DataFrame) -> float:
    """Problems solved a second, the median of the repeats."""
    return 1e-6 * float(np.median(rows["solved"].to_numpy() / rows["seconds"].to_numpy()))


def extra_memory(rows: pl.DataFrame) -> float:
    """Memory beyond inputs and outputs, the largest of the repeats."""
    extra = rows["extra_memory_mb"].cast(pl.Float64).drop_nulls().to_numpy()
    return float(extra.max()) if len(extra) else float("nan")


MEASURES = (
    Measure(
        "success", "%", lambda rows: 100.0 * (rows["solved"].to_numpy() / rows["count"].to_numpy()).min(), "solved",
        show="exact",
    ),
    Measure("million_per_second", "million", solved_rate, "solved per second"),
    Measure("extra_memory_mb", "MB", extra_memory, "memory beyond inputs and outputs"),
)  # fmt: skip
"""What a target of a batch may ask for."""


def judge(rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
    """Value of a target at the largest number of threads: the median of the repeats, of memory the largest."""
    if rows is None or rows.is_empty():
        return float("nan"), "it was not run"
    most = rows.filter(pl.col("threads") == pl.col("threads").max())
    value = measure_named(MEASURES, target.measure, "measure").values(most)[0]
    if np.isnan(value):
        return value, "not reported by this system"
    return value, f"{most['count'][0]:,} problems, {most['threads'][0]} threads, {len(most)} times"
