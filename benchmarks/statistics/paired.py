"""Paired tests of two methods on the same problems, Holm's correction for several tests, and ties with the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.statistics.intervals import STANDS_FOR_INFINITY

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


def not_beaten(best: str, solved: Mapping[str, Mapping[int, bool]]) -> tuple[str, ...]:
    """Return the best method and those not significantly different by McNemar's test with Holm's correction.

    Intervals of two shares may overlap although one method solves nearly all that the other solves and more: the test
    compares problem by problem.
    """
    p_values = {}
    for label in (label for label in solved if label != best):
        shared = sorted(solved[best].keys() & solved[label].keys())
        p_values[label] = mcnemar([solved[best][k] for k in shared], [solved[label][k] for k in shared]).p
    return not_told_apart(best, p_values)


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
