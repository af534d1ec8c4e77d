"""Measures of IK methods at iteration budgets, and success at a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import polars as pl

from benchmarks.statistics import quantiles, wilson
from benchmarks.targets import Measure

SUCCESS_LEVELS = (1e-3, 1e-6)
"""Tolerances [m and rad] at which success is judged: a coarse one, and that of a solved problem."""

PER_RADIAN = float(np.rad2deg(1.0))
"""Degrees in a radian: rotation errors are shown in degrees."""


def succeeded(tolerance: float) -> pl.Expr:
    """Whether BOTH errors of a row are within a tolerance, with every joint inside its limits."""
    near = (pl.col("position_error") <= tolerance) & (pl.col("rotation_error") <= tolerance)
    return near & ~pl.col("status").is_in(["outside_limits", "rejected"])


def success(rows: pl.DataFrame, tolerance: float) -> tuple[float, float, float]:
    """Share of successes and its Wilson 95 % interval."""
    count = int(rows.select(succeeded(tolerance).sum()).item()) if len(rows) else 0
    low, high = wilson(count, len(rows))
    return (100.0 * count / len(rows) if len(rows) else float("nan")), 100.0 * low, 100.0 * high


def level_words(tolerance: float) -> str:
    """A tolerance as reports write it: 1e−6."""
    return f"{tolerance:.0e}".replace("e-0", "e−")


def success_at(tolerance: float) -> Measure:
    """Success at a tolerance as a measure."""
    return Measure(
        f"success at {level_words(tolerance)}",
        "%",
        lambda rows: success(rows, tolerance),
        parts=("share", "low", "high"),
        show="share",
    )


def paired(rows: pl.DataFrame) -> pl.DataFrame:
    """Rows of the problems that every method was run on, so that methods are compared on the same ones."""
    methods = rows["method"].n_unique()
    return rows.filter(pl.col("method").n_unique().over("problem") == methods)


def _of(
    column: str, levels: Sequence[float], *, scale: float = 1.0, solved: bool | None = None
) -> Callable[[pl.DataFrame], tuple[float, ...]]:
    """Quantiles of a column, of all rows or of those that are solved or not."""

    def compute(rows: pl.DataFrame) -> tuple[float, ...]:
        if solved is not None:
            rows = rows.filter((pl.col("status") == "solved") == solved)
        return quantiles(scale * rows[column].to_numpy(), levels)

    return compute


_P95 = ("median", "p95")
"""Quantiles that a measure shows side by side."""

MEASURES = (
    *(success_at(level) for level in SUCCESS_LEVELS),
    Measure("position error", "mm", _of("position_error", (0.5, 0.95), scale=1e3), parts=_P95),
    Measure("rotation error", "°", _of("rotation_error", (0.5, 0.95), scale=PER_RADIAN), parts=_P95),
    Measure("iterations, solved", "", _of("iterations", (0.5, 0.95), solved=True), parts=_P95, show="count"),
)
"""Columns of the tables of methods: computed on the rows of one method at one budget."""
