"""Grids along a path that are fine where its pieces are short: all breaks, and cells that grow slowly between; compiled."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.types import Array

GROWTH = 1.25
"""Largest ratio of the lengths of neighbouring cells."""
FIRST_CELL = 0.01
"""Length of the first and of the last cell, relative to others: from rest, s grows with the cube of time."""


def make_graded_grid(breaks: Array, end: float, count: int, per_piece: int) -> Array:
    """Return path parameters from 0 to the end, with a least number of cells in the path and in each piece between breaks.

    The first and the last cell are a hundredth of that, and neighbours differ little.
    """
    inner = breaks[(breaks > 0.0) & (breaks < end)]
    return np.asarray(_make_grid(np.concatenate([[0.0], inner, [end]]), count, per_piece, FIRST_CELL))


@compiled
def _add_cells(length: float, left: float, right: float, most: float, out: Array, begin: int) -> int:
    """Write the cells of a piece from index `begin` on, of lengths `left` and `right` at its ends and up to `most` between."""
    x, y, k, size = 0.0, length, begin, left
    after = 0
    while True:  # from both ends in turn, the shorter first, until they meet
        if size > y - x or right > y - x:
            break
        if size <= right:
            out[k], x, k, size = size, x + size, k + 1, min(size * GROWTH, most)
        else:
            after += 1
            out[out.shape[0] - after], y, right = right, y - right, min(right * GROWTH, most)
    out[k] = y - x
    if k > begin and out[k] < 0.5 * out[k - 1]:
        out[k - 1] = out[k] = 0.5 * (out[k] + out[k - 1])
    k += 1
    for i in range(after):
        out[k] = out[out.shape[0] - after + i]
        k += 1
    return k


@compiled
def _make_grid(breaks: Array, count: int, per_piece: int, first: float) -> Array:
    """Return path parameters (m,) that include all breaks, with a least number of cells in the path and in each piece.

    The first and the last cell have the fraction `first` of the length of others, and neighbours differ little.

    Returns (m,).
    """
    k, most = breaks.shape[0] - 1, breaks[-1] / count
    pieces = np.empty(k)
    for i in range(k):
        pieces[i] = breaks[i + 1] - breaks[i]
    size = np.empty(k + 1)
    size[0], size[k] = first * min(most, pieces[0] / per_piece), first * min(most, pieces[k - 1] / per_piece)
    for i in range(1, k):
        size[i] = min(most, min(pieces[i - 1], pieces[i]) / per_piece)
    for i in range(1, k + 1):
        size[i] = min(size[i], size[i - 1] + (GROWTH - 1.0) * pieces[i - 1])
    for i in range(k - 1, -1, -1):
        size[i] = min(size[i], size[i + 1] + (GROWTH - 1.0) * pieces[i])
    cells = np.empty(2 * (count + k * (per_piece + 200)))
    m = 0
    for i in range(k):
        m = _add_cells(pieces[i], size[i], size[i + 1], min(most, pieces[i] / per_piece), cells, m)
    out = np.empty(m + 1)
    out[0], out[m] = breaks[0], breaks[k]
    i, x = 0, 0.0
    for j in range(m):
        x += cells[j]
        if j < m - 1:
            out[j + 1] = breaks[0] + x
    return out
