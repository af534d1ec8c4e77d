"""The place on any path that is nearest to a pose: a grid whose error is bounded, then Newton's method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from optik.types import Array
from planners.paths._rotation import vector_of

if TYPE_CHECKING:
    from planners.paths.base import Path

Indices = NDArray[np.int64]

TURN = 1e-3
"""What a turn of 1 rad counts beside a distance [m]: next to nothing, but it decides where the tool only turns."""
GRID = 1e-4
"""How far a path may bend away from the chords of the grid [m]."""
MOST_CELLS = 512
"""Of the grid, between two breaks."""
AT_ONCE = 1_000_000
"""Distances from poses to chords in memory at a time."""


def nearest_places(path: Path, poses: Array) -> Array:
    """Places (k,) on the path where |p − x|² + `TURN`² |R − X|²/2 is least, of poses (k, 4, 4); X, x are a pose's parts.

    The path bends away from the chords of a grid by a known bound. So the chords that may be nearest are known, and
    each of them is searched. Two places whose distances differ by less than twice that bound may count as one.
    """
    edges, bend = chords(path, TURN, GRID)
    rows = max(AT_ONCE // bend.size, 1)
    return np.concatenate([_search(path, edges, bend, poses[i : i + rows]) for i in range(0, len(poses), rows)])


def chords(path: Path, turn: float, most: float, least: int = 1) -> tuple[Array, Array]:
    """Edges (m + 1,) of cells in s, and how far the path bends away from the chord of each (m,), by |z''| h²/8.

    Distances are those of `embedded` points, where a turn of 1 rad counts `turn` metres. Cells are so short that the bend
    is at most `most`, but no more than `MOST_CELLS` between two breaks, and at least so many where the path bends.
    """
    breaks, bounds = path.breaks, path.piece_bounds()[:, :, 1]
    second = np.hypot(bounds[:, 0], turn * np.sqrt(1.5) * bounds[:, 1])  # a 3×3 matrix: Frobenius ≤ √3 spectral
    length = np.diff(breaks)
    fewest = np.where(second > 0.0, least, 1)
    cells = np.clip(np.ceil(length * np.sqrt(second / (8.0 * most))), fewest, MOST_CELLS).astype(int)
    which = np.repeat(np.arange(cells.size), cells)
    within = np.arange(which.size) - np.repeat(np.cumsum(cells) - cells, cells)
    edges = breaks[which] + (length / cells)[which] * within
    return np.append(edges, breaks[-1]), (second * (length / cells) ** 2 / 8.0)[which]


def _search(path: Path, edges: Array, bend: Array, poses: Array) -> Array:
    which, cell, part = _candidates(embedded(path.pose(edges), TURN), bend, embedded(poses, TURN))
    low, high = edges[cell], edges[cell + 1]
    s, cost = _newton(path, poses[which], low + part * (high - low), low, high)
    best = np.lexsort((s, cost, which))
    return s[best[np.searchsorted(which[best], np.arange(len(poses)))]]


def embedded(poses: Array, turn: float) -> Array:
    """Poses as points (k, 12) whose squared distance is |p − x|² + turn² |R − X|²/2."""
    return np.concatenate([poses[:, :3, 3], (turn / np.sqrt(2.0)) * poses[:, :3, :3].reshape(-1, 9)], axis=1)


def _candidates(z: Array, bend: Array, x: Array) -> tuple[Indices, Indices, Array]:
    """Pairs of a pose and a chord that may be nearest to it, and where on the chord, from 0 to 1."""
    centre = z.mean(axis=0)
    a, e, x = z[:-1] - centre, np.diff(z, axis=0), x - centre
    length2 = np.einsum("ij,ij->i", e, e)
    along = x @ e.T - np.einsum("ij,ij->i", a, e)
    part = np.clip(along / np.where(length2 > 0.0, length2, 1.0), 0.0, 1.0)
    size = np.einsum("ij,ij->i", x, x)[:, None] + np.einsum("ij,ij->i", a, a)
    d = np.sqrt(np.maximum(size - 2.0 * (x @ a.T) + part * (part * length2 - 2.0 * along), 0.0))
    rounding = 1e-7 * np.sqrt(size.max())  # the square root of the rounding in a difference of squares
    near = d - bend <= (d + bend).min(axis=1, keepdims=True) + rounding
    which, cell = np.nonzero(near)
    return which, cell, part[which, cell]


def _newton(path: Path, poses: Array, s: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Places (k,) of least cost within [low, high] by Newton's method inside a shrinking bracket, and the costs."""
    s, low, high = s.copy(), low.copy(), high.copy()
    active = np.arange(s.size)
    for step in range(60):
        slope, curvature = _slope(path, poses[active], s[active])
        low[active] = np.where(slope <= 0.0, s[active], low[active])
        high[active] = np.where(slope >= 0.0, s[active], high[active])
        new = s[active] - np.divide(slope, curvature, out=np.full(slope.shape, np.inf), where=curvature > 0.0)
        # a cell whose least cost is at its end is found so at once; what else Newton throws out is halved
        kept = np.clip(new, low[active], high[active])
        half = 0.5 * (low[active] + high[active])
        new = np.where((kept == new) | ((step < 2) & (curvature > 0.0)), kept, half)
        moved = np.abs(new - s[active])
        s[active] = new
        active = active[moved > 1e-9 * path.end]
        if not active.size:
            break
    return s, _cost(path, poses, s)


def _cost(path: Path, poses: Array, s: Array) -> Array:
    at = path.pose(s)
    r = at[:, :3, 3] - poses[:, :3, 3]
    return np.asarray(np.einsum("ki,ki->k", r, r) + TURN**2 * (3.0 - np.einsum("kij,kij->k", *_turns(at, poses))))


def _slope(path: Path, poses: Array, s: Array) -> tuple[Array, Array]:
    """First and second derivative (k,) of half the cost, by R' = ω×R and R'' = (ω'× + ω×ω×) R."""
    at, first, second = path.pose(s), path.twist(s), path.twist(s, 2)
    r, v, w = at[:, :3, 3] - poses[:, :3, 3], first[:, :3], first[:, 3:]
    R, X = _turns(at, poses)
    M = R @ np.swapaxes(X, 1, 2)
    axis = vector_of(M)
    turn = np.einsum("kii->k", M) * np.einsum("ki,ki->k", w, w) - np.einsum("ki,kij,kj->k", w, M, w)
    half = 0.5 * TURN**2
    slope = np.einsum("ki,ki->k", r, v) + half * np.einsum("ki,ki->k", w, axis)
    curvature = np.einsum("ki,ki->k", v, v) + np.einsum("ki,ki->k", r, second[:, :3])
    return slope, curvature + half * (np.einsum("ki,ki->k", second[:, 3:], axis) + turn)


def _turns(a: Array, b: Array) -> tuple[Array, Array]:
    return a[:, :3, :3], b[:, :3, :3]
