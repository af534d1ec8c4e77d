"""Statistics of a comparison: quantiles, confidence interval of a proportion, and quantiles in bins of a column."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
import polars as pl
from numpy.typing import ArrayLike


def quantiles(values: ArrayLike, levels: Sequence[float]) -> tuple[float, ...]:
    """Quantiles by linear interpolation between order statistics.

    Parameters
    ----------
    values : (k,) array
        Values without NaN, in any unit [as the result].
    levels : sequence of float
        Levels of the quantiles, from 0 to 1.

    Returns
    -------
    tuple of float
        The quantile of each level; NaN if there are no values.
    """
    x = np.asarray(values, dtype=float)
    if x.size == 0:
        return (float("nan"),) * len(levels)
    return tuple(float(q) for q in np.quantile(x, levels))


def wilson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson score interval of a proportion.

    SciPy computes it only together with a binomial test, which takes a thousand times longer.

    Parameters
    ----------
    successes, trials : int
        Number of successes, and of trials.
    confidence : float
        Confidence level of the interval.

    Returns
    -------
    tuple of float
        Lower and upper end, from 0 to 1; NaN without trials.
    """
    if trials == 0:
        return float("nan"), float("nan")
    z, p = NormalDist().inv_cdf(0.5 + confidence / 2), successes / trials
    middle = p + z * z / (2 * trials)
    half = z * math.sqrt(p * (1 - p) / trials + (z / (2 * trials)) ** 2)
    low, high = ((middle + sign * half) / (1 + z * z / trials) for sign in (-1, 1))
    return (0.0 if successes == 0 else low), (1.0 if successes == trials else high)


def binned(
    rows: pl.DataFrame, by: str, column: str, *, width: float, least: int = 10, levels: Sequence[float] = (0.5, 0.95)
) -> pl.DataFrame:
    """Quantiles of one column in bins of equal width of another.

    Parameters
    ----------
    rows : DataFrame
        Table with both columns.
    by, column : str
        Column that is divided into bins from 0 upwards, and column of which quantiles are computed.
    width : float
        Width of a bin, in the unit of `by`.
    least : int
        Bins with fewer rows are omitted: too few for quantiles.
    levels : sequence of float
        Levels of the quantiles, from 0 to 1.

    Returns
    -------
    DataFrame
        ``middle`` of each bin, ``count``, and one column ``q0.5``, ``q0.95``, … for each level, in order of `by`.
    """
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
