"""Summaries: quantiles, also in bins of a column, the shifted geometric mean, and performance profiles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from optik.types import Array


def quantiles(values: ArrayLike, levels: Sequence[float]) -> tuple[float, ...]:
    """Return quantiles by linear interpolation between order statistics."""
    x = np.asarray(values, dtype=float)
    if x.size == 0:
        return (float("nan"),) * len(levels)
    below, above = (np.quantile(x, levels, method=method) for method in ("lower", "higher"))
    finite = np.isfinite(below) & np.isfinite(above)
    between = np.quantile(np.where(np.isfinite(x), x, np.finfo(float).max), levels)  # ∞ − ∞ is NaN: no sum may have one
    return tuple(float(q) for q in np.where(finite, between, above))


def shifted_geometric_mean(values: ArrayLike, shift: float) -> float:
    """Return the shifted geometric mean, exp(mean(log(x + shift))) − shift: for times, which spread over powers of ten.

    The shift keeps values far below it from deciding the mean.
    """
    x = np.asarray(values, dtype=float)
    return float(np.exp(np.mean(np.log(x + shift))) - shift) if x.size else float("nan")


def binned(
    rows: pl.DataFrame, by: str, column: str, *, width: float, least: int = 10, levels: Sequence[float] = (0.5, 0.95)
) -> pl.DataFrame:
    """Return quantiles of one column in bins of equal width of another."""
    return (
        rows.group_by(bin=(pl.col(by) / width).floor())
        .agg(
            pl.len().alias("count"),
            *(pl.col(column).quantile(level, interpolation="linear").alias(f"q{level:g}") for level in levels),
        )
        .filter(pl.col("count") >= least)
        .sort("bin")
        .select(((pl.col("bin") + 0.5) * width).alias("middle"), pl.exclude("bin"))
    )


def performance_profile(costs: ArrayLike, ratios: ArrayLike) -> Array:
    """Return the fraction of problems that each method solves within a multiple of the least cost of any method there.

    These are the performance profiles of Dolan and Moré (2002). A problem that no method solved counts among the problems
    and is solved by none.
    """
    cost = np.asarray(costs, dtype=float)
    best = cost.min(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        relative = np.where(np.isfinite(cost), cost / best, np.inf)
    levels = np.asarray(ratios, dtype=float)
    ordered = np.sort(relative, axis=0)
    counts = [np.searchsorted(ordered[:, j], levels, side="right") for j in range(cost.shape[1])]
    return np.stack(counts, axis=1) / len(cost)
