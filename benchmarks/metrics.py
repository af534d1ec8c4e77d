"""Metrics of IK methods: each is one object in one tuple, computed from the rows of a run at one budget."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from benchmarks.statistics import quantiles, wilson

Compute = Callable[[pl.DataFrame], tuple[float, ...]]

LEVELS = (1e-3, 1e-6)
"""Tolerances [m and rad] at which success is judged."""


@dataclass(frozen=True)
class Metric:
    """One figure of merit.

    Attributes
    ----------
    name : str
        What it is.
    unit : str
        Of all its values.
    parts : tuple of str
        What each of its values is.
    compute : callable
        From the rows of one method at one budget to one value a part.
    kind : str
        How it is shown: "number", "count" (whole where it can be), or "share" (with its interval).
    """

    name: str
    unit: str
    parts: tuple[str, ...]
    compute: Compute
    kind: str = "number"


def succeeded(tolerance: float) -> pl.Expr:
    """Whether BOTH errors of a row are within a tolerance [m and rad], with every joint inside its limits."""
    near = (pl.col("position_error") <= tolerance) & (pl.col("rotation_error") <= tolerance)
    return near & ~pl.col("status").is_in(["outside_limits", "rejected"])


def success(rows: pl.DataFrame, tolerance: float) -> tuple[float, float, float]:
    """Share of successes [%] and its Wilson 95 % interval."""
    count = int(rows.select(succeeded(tolerance).sum()).item()) if len(rows) else 0
    low, high = wilson(count, len(rows))
    return (100.0 * count / len(rows) if len(rows) else float("nan")), 100.0 * low, 100.0 * high


def level_words(tolerance: float) -> str:
    """A tolerance as reports write it: 1e−6."""
    return f"{tolerance:.0e}".replace("e-0", "e−")


def success_at(tolerance: float) -> Metric:
    """Success as a metric."""
    return Metric(
        f"success at {level_words(tolerance)}",
        "%",
        ("share", "low", "high"),
        lambda rows: success(rows, tolerance),
        "share",
    )


def _of(column: str, levels: Sequence[float], *, scale: float = 1.0, solved: bool | None = None) -> Compute:
    def compute(rows: pl.DataFrame) -> tuple[float, ...]:
        if solved is not None:
            rows = rows.filter((pl.col("status") == "solved") == solved)
        return quantiles(scale * rows[column].to_numpy(), levels)

    return compute


DEGREES = float(np.rad2deg(1.0))
METRICS = (
    *(success_at(level) for level in LEVELS),
    Metric("position error", "mm", ("median", "p95"), _of("position_error", (0.5, 0.95), scale=1e3)),
    Metric("rotation error", "°", ("median", "p95"), _of("rotation_error", (0.5, 0.95), scale=DEGREES)),
    Metric("iterations, solved", "", ("median", "p95"), _of("iterations", (0.5, 0.95), solved=True), "count"),
    Metric("time a call, solved", "µs", ("median", "p95", "p99"), _of("seconds", (0.5, 0.95, 0.99), scale=1e6, solved=True)),
    Metric("time a call, not solved", "µs", ("median", "p95"), _of("seconds", (0.5, 0.95), scale=1e6, solved=False)),
)  # fmt: skip


def paired(rows: pl.DataFrame) -> pl.DataFrame:
    """Rows of the problems that every method was run on, so that methods are compared on the same ones."""
    methods = rows["method"].n_unique()
    return rows.filter(pl.col("method").n_unique().over("problem") == methods)
