"""Confidence intervals: Wilson's of a proportion, bootstrap intervals of medians and of their ratio."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from statistics import NormalDist
from typing import Any

import numpy as np
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
