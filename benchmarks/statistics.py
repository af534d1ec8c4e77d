"""Statistics of a comparison: summaries, intervals, and paired tests with Holm's correction."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from optik.types import Array

RESAMPLES = 1000
"""Resamples of a bootstrap: the ends of a 95 % interval are then the 25th value from either end."""

MOST_RESAMPLED = 2000
"""Largest number of values that are resampled: of more, this many are sampled; the interval is then wider."""

RESAMPLED_AT_ONCE = 250
"""Resamples that are computed at once, so that a bootstrap needs little memory."""

STANDS_FOR_INFINITY = 1e100
"""Value that represents infinity in a bootstrap: quantiles between a number and infinity would be NaN; its square is finite."""


def wilson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the Wilson score interval of a proportion.

    SciPy computes it only together with a binomial test, which takes a thousand times longer.
    """
    if trials == 0:
        return float("nan"), float("nan")
    z, p = NormalDist().inv_cdf(0.5 + confidence / 2), successes / trials
    middle = p + z * z / (2 * trials)
    half = z * math.sqrt(p * (1 - p) / trials + (z / (2 * trials)) ** 2)
    low, high = ((middle + sign * half) / (1 + z * z / trials) for sign in (-1, 1))
    return (0.0 if successes == 0 else low), (1.0 if successes == trials else high)


def percentage(successes: int, trials: int) -> tuple[float, float, float]:
    """Return the proportion and its Wilson 95 % interval [%]; NaN without trials."""
    low, high = wilson(successes, trials)
    return (100.0 * successes / trials if trials else float("nan")), 100.0 * low, 100.0 * high


def median_interval(values: ArrayLike, confidence: float = 0.95) -> tuple[float, float, float]:
    """Return the median and its percentile bootstrap interval."""
    x = np.minimum(np.asarray(values, dtype=float), STANDS_FOR_INFINITY)
    if x.size == 0:
        return (float("nan"),) * 3
    return _percentile((x,), lambda x, axis: np.median(x, axis=axis), confidence)


def ratio_interval(first: ArrayLike, second: ArrayLike, confidence: float = 0.95) -> tuple[float, float, float]:
    """Return the ratio of two medians of paired values and its percentile bootstrap interval; pairs are resampled."""
    x, y = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if x.size == 0:
        return (float("nan"),) * 3
    return _percentile((x, y), lambda x, y, axis: np.median(x, axis=axis) / np.median(y, axis=axis), confidence)


def _percentile(
    samples: tuple[Array, ...], statistic: Callable[..., Any], confidence: float
) -> tuple[float, float, float]:
    """Return a statistic of all values with its interval; the random numbers depend only on the values."""
    value = float(statistic(*samples, axis=-1))
    ends = (float("nan"), float("nan"))
    if len(samples[0]) > 1:
        rng = np.random.default_rng(_seed(samples))
        part, scale = samples, 1.0
        if len(samples[0]) > MOST_RESAMPLED:
            chosen = rng.choice(len(samples[0]), MOST_RESAMPLED, replace=False)
            part = tuple(sample[chosen] for sample in samples)
            drawn = float(statistic(*part, axis=-1))
            scale = value / drawn if drawn else 1.0  # the interval is that of the part, around the value of all
        ends = _bootstrap(part, statistic, confidence, rng)
        ends = (scale * ends[0], scale * ends[1])
    return tuple(math.inf if x > 0.1 * STANDS_FOR_INFINITY else x for x in (value, *ends))  # type: ignore[return-value]


def _bootstrap(
    samples: tuple[Array, ...], statistic: Callable[..., Any], confidence: float, rng: np.random.Generator
) -> tuple[float, float]:
    from scipy.stats import bootstrap

    found = bootstrap(
        samples, statistic, n_resamples=RESAMPLES, batch=RESAMPLED_AT_ONCE, vectorized=True, paired=True, axis=-1,
        confidence_level=confidence, method="percentile", rng=rng,
    ).confidence_interval  # fmt: skip
    return float(found.low), float(found.high)


def _seed(samples: tuple[Array, ...]) -> int:
    """Return a seed computed from the values: the same rows have the same interval on every machine."""
    digest = hashlib.sha256()
    for sample in samples:
        digest.update(np.ascontiguousarray(sample, dtype="<f8").tobytes())
    return int.from_bytes(digest.digest()[:8], "little")


SIGNIFICANT = 0.05
"""Largest p-value of a test at which one method counts as better than another."""


@dataclass(frozen=True)
class McNemar:
    """McNemar's exact test of the problems that two methods solved: both, only one, or neither."""

    both: int
    first: int
    second: int
    neither: int
    p: float  # two-sided p-value of "each is as likely to be the only one"; 1 without discordant pairs


def mcnemar(first: ArrayLike, second: ArrayLike) -> McNemar:
    """McNemar's exact test."""
    a, b = np.asarray(first, dtype=bool), np.asarray(second, dtype=bool)
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    return McNemar(int((a & b).sum()), only_a, only_b, int((~a & ~b).sum()), mcnemar_p(only_a, only_b))


def mcnemar_p(only_first: int, only_second: int) -> float:
    """Return the two-sided p-value of McNemar's exact test."""
    if not only_first + only_second:
        return 1.0
    from scipy.stats import binomtest

    return float(binomtest(only_first, only_first + only_second, 0.5).pvalue)


def not_longer(best: str, values: Mapping[str, ArrayLike]) -> tuple[str, ...]:
    """Return the best and those not significantly longer by Wilcoxon's test with Holm's correction."""
    mine = np.asarray(values[best], dtype=float)
    p_values = {label: signed_rank(x, mine) for label, x in values.items() if label != best}
    shorter = {label: 1.0 for label in p_values if np.sum(values[label] > mine) <= np.sum(values[label] < mine)}
    return not_told_apart(best, p_values | shorter)


def not_told_apart(best: str, p_values: Mapping[str, float]) -> tuple[str, ...]:
    """Return the best and those not significantly different by a test with Holm's correction."""
    corrected = holm(list(p_values.values()))
    return (best, *(label for label, p in zip(p_values, corrected, strict=True) if not p < SIGNIFICANT))


def is_too_few(count: int, comparisons: int) -> bool:
    """Say whether no result of some paired values can be significant after Holm's correction of some comparisons.

    The least p-value of McNemar's and Wilcoxon's exact two-sided tests is 2^(1 − n).
    """
    return comparisons * 2.0 ** (1 - count) >= SIGNIFICANT


def signed_rank(first: ArrayLike, second: ArrayLike) -> float:
    """Return the two-sided p-value of Wilcoxon's signed-rank test on the logarithms of two paired samples of times or errors.

    Logarithms, because times differ by factors: the test asks whether ratios above and below 1 balance.
    """
    x, y = (np.minimum(np.asarray(sample, dtype=float), STANDS_FOR_INFINITY) for sample in (first, second))
    if x.size == 0:
        return float("nan")
    difference = np.log(x) - np.log(y)
    if not difference.any():
        return 1.0
    from scipy.stats import wilcoxon

    return float(wilcoxon(difference).pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values with Holm's step-down correction (Holm 1979), which bounds the family-wise error."""
    p = np.asarray(p_values, dtype=float)
    found = np.full(p.shape, np.nan)
    order = [int(i) for i in np.argsort(p, kind="stable") if not np.isnan(p[i])]
    largest = 0.0
    for rank, i in enumerate(order):
        largest = max(largest, min(1.0, (len(order) - rank) * float(p[i])))
        found[i] = largest
    return [float(x) for x in found]


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
