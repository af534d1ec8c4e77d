"""Ratio of the tool's speed to limits that differ between segments of the path: a proved upper bound."""

from __future__ import annotations

import numpy as np

from optik.types import Array, Indices
from planners.certificate.bounds import MotionBounds
from planners.certificate.path_error import Passage
from planners.certificate.projection import Nearest
from planners.paths.base import Path

CROSSING_ROUNDING = 1e-12
"""Fraction of the path, and of the duration, below which two positions, or two instants, are the same: rounding is near."""
CROSSING_STEPS = 60
"""Largest number of steps to the instant at which a break is passed; three Newton steps are usual."""


def segment_speed(
    bounds: MotionBounds, path: Path, passage: Passage, on_pieces: Array, part: int
) -> tuple[float, float]:
    """Return a bound on the ratio of the tool's speed to the limit of the current piece of the path, and its time.

    The current piece is that of s(t), the projection onto the path (`planners.certificate.path_error`). If s(t) decreases
    within an interval, the least limit of all its pieces counts.
    """
    piece, begin, end, limit = _stretches(bounds, path, passage, on_pieces)
    ends, limits = bounds.at(np.tile(piece, 2), np.concatenate([begin, end])), np.full((piece.size, 2), np.inf)
    limits[:, part] = limit
    proved, _, when = bounds.bound_speeds(piece, ends, limits)
    return float(proved[part]), float(when[part])


def _stretches(
    bounds: MotionBounds, path: Path, passage: Passage, on_pieces: Array
) -> tuple[Indices, Array, Array, Array]:
    """Return intervals of time (k,) with one limit each: their pieces of the motion, starts, ends [s] and limits."""
    t, s, inner = passage.t, passage.s, path.breaks[1:-1]
    low, high = np.minimum(s[:-1], s[1:]), np.maximum(s[:-1], s[1:])
    back = s[1:] < s[:-1]
    for when, top, _, bottom in passage.falls:
        i = min(int(np.searchsorted(t, when, side="right")) - 1, low.size - 1)
        low[i], high[i], back[i] = min(low[i], bottom), max(high[i], top), True
    first = np.searchsorted(inner, low + CROSSING_ROUNDING * path.end, side="right")
    last = np.maximum(first, np.searchsorted(inner, high - CROSSING_ROUNDING * path.end, side="left"))
    piece = np.cumsum(passage.knot)[:-1] - 1
    limit = on_pieces[first]
    for k in np.flatnonzero(back & (first < last)):
        limit[k] = on_pieces[first[k] : last[k] + 1].min()
    changes = np.flatnonzero(on_pieces[1:] != on_pieces[:-1])  # inner breaks at which the limit changes
    count = np.searchsorted(changes, last) - np.searchsorted(changes, first)
    count[back] = 0
    parted = np.repeat(np.arange(count.size), count)  # intervals, once for each change in them
    if not parted.size:
        return _merge(piece, t[:-1], limit, t[-1])
    nth = np.arange(parted.size) - np.repeat(np.cumsum(count) - count, count)
    crossed = changes[np.searchsorted(changes, first[parted]) + nth]
    knots = t[passage.knot]
    within = (knots[piece[parted]], knots[piece[parted] + 1]) if not back.any() else (t[parted], t[parted + 1])
    when = _crossings(bounds, path, piece[parted], within, inner[crossed])
    begin, after = np.concatenate([t[:-1], when]), np.concatenate([limit, on_pieces[crossed + 1]])
    owner = np.concatenate([piece, piece[parted]])
    order = np.lexsort((np.arange(begin.size), begin))
    return _merge(owner[order], begin[order], after[order], t[-1])


def _merge(piece: Indices, begin: Array, limit: Array, end: float) -> tuple[Indices, Array, Array, Array]:
    """Return intervals as `_stretches`, without bounds between two of one piece and one limit.

    Thus the ratio does not depend on the intervals of the projection, which are others for a motion from a file.
    """
    kept = np.append(True, (piece[1:] != piece[:-1]) | (limit[1:] != limit[:-1]))
    begin = begin[kept]
    return piece[kept], begin, np.append(begin[1:], end), limit[kept]


def _crossings(bounds: MotionBounds, path: Path, piece: Indices, ends: tuple[Array, Array], places: Array) -> Array:
    """Return the instants (k,) at which a motion passes positions along its path: Newton's method within a bisection."""
    nearest, (low, high) = Nearest(path), ends
    t, shortest = 0.5 * (low + high), CROSSING_ROUNDING * float(bounds.knots[-1])
    for _ in range(CROSSING_STEPS):
        found = nearest.places(bounds.at(piece, t), places)
        off = found.s - places
        low, high = np.where(off < 0.0, t, low), np.where(off < 0.0, high, t)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = t - off / found.speed
        after = np.where((after > low) & (after < high), after, 0.5 * (low + high))
        settled = np.abs(after - t).max() <= shortest
        t = after
        if settled:
            break
    return t
