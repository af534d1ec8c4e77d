"""A path as marching needs it: poses, twists, the free motion of a redundant arm, and bounds, at places s."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik.compiled import compiled
from optik.ik import Tolerance
from optik.types import Array
from planners.following.joint_path import APART, fourth_bounds
from planners.paths.base import Path

Bools = NDArray[np.bool_]

SHARE = 0.2
"""Share of the tolerance that the path's own bend may take of a step; the joints, whose bounds are wider, need the rest."""

MOST_PLACES = 100_000
"""More are put only where a step is refused."""

Guide = Callable[[Array], tuple[Array, Array]]
"""The free motion of a redundant arm: rows (k, 4, d, n) and values (k, 4, d) at s (k,), as `derivatives_at` takes them."""


class Nodes(NamedTuple):
    """A path at places s (k,): poses, twists (k, 3, 6), the rows and values of the free motion, bounds (k, 2)."""

    s: Array
    poses: Array
    twists: Array
    rows: Array
    values: Array
    fourth: Array


class Course:
    """A path with its free motion, as marching needs them."""

    def __init__(self, path: Path, guide: Guide) -> None:
        self.path, self.guide = path, guide
        self.pieces = path.piece_bounds()

    def nodes(self, s: Array) -> Nodes:
        """The path at places s (k,)."""
        twists = np.empty((s.size, 3, 6))
        for order in (1, 2, 3):
            twists[:, order - 1] = self.path.twist(s, order)
        return Nodes(s, self.path.pose(s), twists, *self.guide(s), fourth_bounds(self.path, s, self.pieces))

    def spread(self, s: Array, tolerance: Tolerance) -> Array:
        """Places to march through: those given, the path's breaks, and more where it bends; no nearer than it needs.

        Where the path's own share of the deviation from it, h⁴/384 · |d⁴/ds⁴|, needs no shorter step, breaks and samples
        nearer than `APART` are left out, so that rounding does not show in third derivatives.
        """
        breaks, fourth = self.path.breaks, self.pieces[:, :, 3]
        with np.errstate(divide="ignore"):
            share = (SHARE * np.array([tolerance.position, tolerance.rotation]) / fourth).min(axis=1)
        step = np.sqrt(np.sqrt(384.0 * share))  # longest in each piece
        if len(breaks) > 2:
            s = np.union1d(s, breaks[1:-1])
        gap = np.diff(s)
        step = step[np.clip(np.searchsorted(breaks, s[:-1] + 0.5 * gap, side="right") - 1, 0, len(step) - 1)]
        parts = np.maximum(np.ceil(gap / step), 1.0).astype(np.int64)
        if parts.max() > 1:
            if parts.sum() > MOST_PLACES:
                parts = np.minimum(parts, 16)
            u = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
            s, step = (
                np.append(np.repeat(s[:-1], parts) + np.repeat(gap / parts, parts) * u, s[-1]),
                np.repeat(step, parts),
            )
            gap = np.diff(s)
        if gap.min() >= APART:
            return s
        kept = np.ones(len(s), np.bool_)
        thin(s, step, np.isin(s, breaks), kept)
        return np.asarray(s[kept])


@compiled
def thin(s: Array, step: Array, preferred: Bools, kept: Bools) -> None:
    """Leave out places that are nearer to the one before than `APART`, and than `step` (k − 1,) from each to the next asks.

    Of two the preferred one stays; both ends always do.
    """
    last, longest = 0, step[0]
    for i in range(1, s.shape[0] - 1):
        least = min(longest, step[i])
        may = s[i + 1] - s[last] <= least
        near = s[i] - s[last] < APART
        yields = s[i + 1] - s[i] < APART and not preferred[i] and (preferred[i + 1] or i + 2 == s.shape[0])
        kept[i] = not (may and (near or yields))
        if kept[i]:
            last, longest = i, step[i]
        else:
            longest = least


def part(nodes: Nodes, first: int, last: int | None = None) -> Nodes:
    """Nodes first to last, without copying them."""
    return Nodes(*(x[first:last] for x in nodes))


def unguided(n: int) -> Guide:
    """The guide of an arm without free motion."""
    return lambda s: (np.empty((s.size, 4, 0, n)), np.empty((s.size, 4, 0)))
