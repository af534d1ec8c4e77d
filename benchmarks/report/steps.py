"""Empirical distributions for plots: every step of the data, or a bounded number of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik.types import Array

MOST_STEPS = 300
"""Number of plotted steps of a distribution: enough for a plot of some hundred pixels."""


def steps_of(values: ArrayLike, count: int, most: int = MOST_STEPS) -> tuple[Array, Array]:
    """Return the fraction of `count` at or below each value: an empirical distribution, to be drawn with level steps.

    Of more steps than `most`, half are evenly spaced in their share, half become ever denser towards either end; the first
    and the last are always there, and each that is drawn is exact.
    """
    x, counts = np.unique(np.asarray(values, dtype=float), return_counts=True)
    share = 100.0 * np.cumsum(counts) / count
    if len(x) > most:
        even = np.searchsorted(share, np.linspace(share[0], share[-1], most // 2))
        dense = np.geomspace(1.0, len(x), most // 4).astype(int) - 1
        chosen = np.unique(np.concatenate([[0, len(x) - 1], even, dense, len(x) - 1 - dense]).clip(0, len(x) - 1))
        x, share = x[chosen], share[chosen]
    return np.concatenate([x[:1], x]), np.concatenate([[0.0], share])
