"""Viability: the least acceleration of the clock from which the motion can still be braked within the limits."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.types import Array
from planners.timing._brake.rows import Cells, jerks_at, least_acceleration, lines_at

CLOCK_RATES = 8
"""Number of clock rates for which the least b is found."""
BISECTIONS = 7
"""Number of bisections of the interval of b in that search."""


@compiled
def viable(cells: Cells, top: float, share: float, jerk: float, least: Array) -> None:
    """Fill in the least b (k + 1, CLOCK_RATES + 1) from which b = 0 is reached, at the cells' ends, for rates up to `top`."""
    line, after = np.empty((2, 3, 2 * cells.edge.shape[2] + 2))
    last = cells.x.shape[0] - 1
    for i in range(last, -1, -1):
        cell, part = (i, 0.0) if i < last else (i - 1, 1.0)
        for r in range(1, CLOCK_RATES + 1):
            w = top * r / CLOCK_RATES
            low, _, n = lines_at(cells, cell, part, w, share, jerk, line)
            if i < last:
                other, _, m = lines_at(cells, cell, 1.0, w, share, jerk, after)
                line[:, n : n + m] = after[:, :m]
                low, n = max(low, other), n + m
            low = min(least_acceleration(line, n, max(low, -2.0 * np.sqrt(jerk * top))), 0.0)
            if i < last and not _onward(cells, i, w, low, line, n, top, least):
                high = 0.0
                for _ in range(BISECTIONS):
                    b = 0.5 * (low + high)
                    if _onward(cells, i, w, b, line, n, top, least):
                        high = b
                    else:
                        low = b
                low = high
            least[i, r] = low * cells.soft[i]


@compiled
def _onward(cells: Cells, i: int, w: float, b: float, line: Array, n: int, top: float, least: Array) -> bool:
    """Return whether the greatest j leads from w and b at a cell's start to above the least b at its end, or to rest before."""
    low, high = jerks_at(line, n, b)
    if high < low:
        return False
    d = cells.x[i + 1] - cells.x[i]
    square = w * w + 2.0 * b * d
    if square <= 0.01 * w * w:
        return b * b <= 2.0 * max(high, 0.0) * w
    after = np.sqrt(square)
    h = 2.0 * d / (w + after)
    then = b + high * h
    after = min(max(w + 0.5 * (b + min(then, 0.0)) * h, 0.1 * w), top)
    return bool(then >= bound_at(least, i + 1, after, top))


@compiled
def bound_at(least: Array, i: int, w: float, top: float) -> float:
    """Return the least b at a cell's end, interpolated over the rate; near rate 0 it is proportional to the square root."""
    r = w / top * CLOCK_RATES
    if r <= 1.0:
        return float(least[i, 1] * np.sqrt(r))
    k = min(int(r), CLOCK_RATES - 1)
    return float((k + 1.0 - r) * least[i, k] + (r - k) * least[i, k + 1])
