"""A path sampled for marching: poses, twists, null-space guide of a redundant arm, and bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from optik.compiled import compiled
from optik.ik import Tolerance
from optik.types import Array, Flags
from planners.following.joint_path import LEAST_SPACING, fourth_bounds
from planners.paths.base import Path

FOURTH_FRACTION = 0.2
"""Fraction of the tolerance that the path's fourth derivative may use in a step; the bound of the joints is wider."""

MOST_INSERTED = 100_000
"""Most samples that are inserted beforehand where the path bends; more are inserted only where a step is rejected."""

Guide = Callable[[Array], tuple[Array, Array]]
"""Constraint on the motion of a redundant arm: rows (k, 4, d, n) and values (k, 4, d) at s (k,), for `derivatives_at`."""


class Nodes(NamedTuple):
    """A path at s (k,): poses, twists (k, 3, 6), rows and values of the guide, bounds (k, 2) on fourth derivatives."""

    s: Array
    poses: Array
    twists: Array
    rows: Array
    values: Array
    fourth: Array


class Course:
    """A path with its null-space guide, to be sampled for marching."""

    def __init__(self, path: Path, guide: Guide) -> None:
        self.path, self.guide = path, guide
        self.pieces = path.piece_bounds()

    def nodes(self, s: Array) -> Nodes:
        """Return the path and its guide at s (k,)."""
        twists = np.empty((s.size, 3, 6))
        for order in (1, 2, 3):
            twists[:, order - 1] = self.path.twist(s, order)
        return Nodes(s, self.path.pose(s), twists, *self.guide(s), fourth_bounds(self.path, s, self.pieces))

    def spread(self, s: Array, tolerance: Tolerance) -> Array:
        """Return the values of s to march through: those given, the path's breaks, and more where the path bends.

        The path's contribution to the deviation in a step is h⁴/384 · |d⁴/ds⁴|. Breaks and samples nearer than `LEAST_SPACING`,
        in whose third derivatives rounding would show, are left out unless this contribution needs a shorter step.
        """
        breaks, fourth = self.path.breaks, self.pieces[:, :, 3]
        with np.errstate(divide="ignore"):
            share = (FOURTH_FRACTION * np.array([tolerance.position, tolerance.rotation]) / fourth).min(axis=1)
        step = np.sqrt(np.sqrt(384.0 * share))  # longest in each piece
        if len(breaks) > 2:
            s = np.union1d(s, breaks[1:-1])
        gap = np.diff(s)
        step = step[np.clip(np.searchsorted(breaks, s[:-1] + 0.5 * gap, side="right") - 1, 0, len(step) - 1)]
        parts = np.maximum(np.ceil(gap / step), 1.0).astype(np.int64)
        if parts.max() > 1:
            if parts.sum() > MOST_INSERTED:
                parts = np.minimum(parts, 16)
            u = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
            s, step = (
                np.append(np.repeat(s[:-1], parts) + np.repeat(gap / parts, parts) * u, s[-1]),
                np.repeat(step, parts),
            )
            gap = np.diff(s)
        if gap.min() >= LEAST_SPACING:
            return s
        kept = np.ones(len(s), np.bool_)
        thin(s, step, np.isin(s, breaks), kept)
        return np.asarray(s[kept])


@compiled
def thin(s: Array, step: Array, preferred: Flags, kept: Flags) -> None:
    """Leave out values of s nearer than `LEAST_SPACING` to the previous one, where the step may be that long.

    Of two near ones the preferred one is kept; both ends are always kept.

    Shapes and units: s (k,) [m, or rad], step (k - 1,) [m, or rad], preferred (k,), kept (k,).
    """
    last, longest = 0, step[0]
    for i in range(1, s.shape[0] - 1):
        least = min(longest, step[i])
        may = s[i + 1] - s[last] <= least
        near = s[i] - s[last] < LEAST_SPACING
        yields = s[i + 1] - s[i] < LEAST_SPACING and not preferred[i] and (preferred[i + 1] or i + 2 == s.shape[0])
        kept[i] = not (may and (near or yields))
        if kept[i]:
            last, longest = i, step[i]
        else:
            longest = least


def slice_nodes(nodes: Nodes, first: int, last: int | None = None) -> Nodes:
    """Return a range of nodes, without copying them."""
    return Nodes(*(x[first:last] for x in nodes))


def make_empty_guide(n: int) -> Guide:
    """Return the guide of an arm without null-space motion."""
    return lambda s: (np.empty((s.size, 4, 0, n)), np.empty((s.size, 4, 0)))
