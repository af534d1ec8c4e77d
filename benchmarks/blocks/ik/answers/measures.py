"""Measures of recorded answers, computed on one row a method: the rows of the answers are never all in memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import polars as pl

from benchmarks.statistics import wilson
from benchmarks.targets import Measure
from optik.types import Flags

TOLERANCE_LABELS = {"1e-3": 1e-3, "1e-6": 1e-6, "1e-9": 1e-9}
"""Tolerances [m and rad] at which an answer is judged: coarse, a solved problem's, and near what rounding allows."""

QUANTILES = {"median": 0.5, "p95": 0.95, "p99": 0.99}
"""Quantiles of the errors."""

BINS_A_DECADE = 10
"""Steps of the distribution of the errors: as fine as a curve of a few hundred pixels shows."""

EXACT = 1e-16
"""Errors [m] below this stand in the first step of their distribution: rounding, and exact zeros."""


def summary(rows: pl.LazyFrame) -> pl.DataFrame:
    """Counts, quantiles and sums of each method."""
    worst = pl.max_horizontal("position_error", "rotation_error")
    columns = [
        pl.len().alias("count"),
        pl.col("solved").sum().alias("claimed"),
        (pl.col("status") == "crashed").sum().alias("crashed"),
        *(
            (pl.col("inside") & (worst <= tolerance)).sum().alias(f"at {name}")
            for name, tolerance in TOLERANCE_LABELS.items()
        ),
        *(
            pl.col(f"{kind}_error").quantile(level, interpolation="linear").alias(f"{kind} {name}")
            for kind in ("position", "rotation")
            for name, level in QUANTILES.items()
        ),
        pl.col("iterations").cast(pl.Float64).mean(),
        pl.col("restarts").cast(pl.Float64).mean(),
        pl.col("seconds").cast(pl.Float64).sum(),
    ]
    found = rows.group_by("method").agg(*columns).sort("method").collect(engine="streaming")
    return found.with_columns(pl.col("method").cast(pl.String))


def distribution(rows: pl.LazyFrame) -> pl.DataFrame:
    """How many answers of each method have a position error in each step of a logarithmic scale."""
    usable = rows.filter(pl.col("inside") & pl.col("position_error").is_finite())
    step = (pl.col("position_error").clip(lower_bound=EXACT).log10() * BINS_A_DECADE).ceil().cast(pl.Int32)
    found = usable.group_by("method", step=step).agg(pl.len().alias("count")).sort("method", "step")
    upper = pl.lit(10.0).pow(pl.col("step") / BINS_A_DECADE)
    return found.collect(engine="streaming").select(pl.col("method").cast(pl.String), upper.alias("upper"), "count")


GOOD = pl.col("inside") & (pl.max_horizontal("position_error", "rotation_error") <= TOLERANCE_LABELS["1e-6"])
"""Whether an answer solves its problem."""


def compared_answers(rows: pl.LazyFrame, part: int) -> pl.DataFrame:
    """Answers as two runs are compared on them."""
    number, label = pl.col("problem").cast(pl.Int64), pl.col("method").cast(pl.String).alias("label")
    each = rows.select(label, number, good=GOOD, seconds=pl.lit(None, dtype=pl.Float64))
    times = rows.group_by(label, problem=-1 - number // part).agg(seconds=pl.col("seconds").cast(pl.Float64).mean())
    times = times.select("label", "problem", good=pl.lit(None, dtype=pl.Boolean), seconds="seconds")
    return pl.concat([each, times]).collect(engine="streaming")


def solved_by_all(rows: pl.LazyFrame, labels: Sequence[str]) -> dict[str, Flags]:
    """Which problems each method solved within 1e-6, of those that all of them were given."""
    found = {}
    for label in labels:
        own = rows.filter(pl.col("method") == label).select("problem", good=GOOD).collect(engine="streaming")
        number = own["problem"].to_numpy()
        found[label] = np.full(int(number.max(initial=0)) + 1, -1, dtype=np.int8)  # -1: not given, or not run yet
        found[label][number] = own["good"].to_numpy()
    count = min(map(len, found.values()))
    given = np.logical_and.reduce([x[:count] >= 0 for x in found.values()])
    return {label: x[:count][given] == 1 for label, x in found.items()}


def _success(name: str) -> Measure:
    def compute(row: pl.DataFrame) -> tuple[float, float, float]:
        solved, count = int(row[f"at {name}"].sum()), int(row["count"].sum())
        low, high = wilson(solved, count)
        return (100.0 * solved / count if count else float("nan")), 100.0 * low, 100.0 * high

    words = f"success at {name.replace('-', '−')}"
    return Measure(words, "%", compute, parts=("share", "low", "high"), show="share")


def _quantiles(kind: str, scale: float) -> Callable[[pl.DataFrame], tuple[float, ...]]:
    return lambda row: tuple(scale * float(row[f"{kind} {name}"][0]) for name in QUANTILES)


MEASURES = (
    *map(_success, TOLERANCE_LABELS),
    Measure("position error", "mm", _quantiles("position", 1e3), parts=tuple(QUANTILES)),
    Measure("rotation error", "rad", _quantiles("rotation", 1.0), parts=tuple(QUANTILES)),
    Measure("mean iterations", "", lambda row: row["iterations"][0]),
    Measure(
        "solved_per_second", "1/s", lambda row: row["at 1e-6"][0] / max(row["seconds"][0], 1e-9), "solved per second and core"
    ),
    Measure("crashed", "", lambda row: row["crashed"][0], show="count"),
)  # fmt: skip
"""What a target of recorded answers may ask for."""
