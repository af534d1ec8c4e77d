"""Performance profiles of several methods on the same problems (Dolan and Moré 2002)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik.types import Array


def performance_profile(costs: ArrayLike, ratios: ArrayLike) -> Array:
    """Return the fraction of problems that each method solves within a multiple of the least cost of any method there.

    A problem that no method solved counts among the problems and is solved by none.
    """
    cost = np.asarray(costs, dtype=float)
    best = cost.min(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        relative = np.where(np.isfinite(cost), cost / best, np.inf)
    levels = np.asarray(ratios, dtype=float)
    ordered = np.sort(relative, axis=0)
    counts = [np.searchsorted(ordered[:, j], levels, side="right") for j in range(cost.shape[1])]
    return np.stack(counts, axis=1) / len(cost)
