"""Proved bound on the peak of a value over a motion, by bounds on intervals that are divided where they are not close."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.types import Array, Flags
from planners.certificate.bounds import NARROWEST_SHARE, MotionBounds, joint_bounds, link_bounds
from planners.limits.inputs import Enclose, Evaluate

DIVIDED, DIVISIONS = 4, 40
"""Parts of a divided interval, and the largest number of divisions."""
PEAK_INTERVALS = 200_000
"""Largest number of bounded intervals; the bound on what is left is then not close."""


def prove_peaks(
    motion: MotionBounds, evaluate: Evaluate, enclose: Enclose, excess: float, count: int
) -> tuple[Array, Array]:
    """Return proved upper bounds (count,) on peak / limit, at most a fraction `excess` above the largest found, and times [s].

    A ratio that is nowhere found above 1 is bounded until it is proved to be at most 1: a part of a valid motion is valid.
    """
    piece, (left, right) = np.arange(motion.knots.size - 1), motion.joint_ends
    begin, end = motion.knots[:-1].copy(), motion.knots[1:].copy()
    first, last = evaluate(left), evaluate(right)
    found, when, proved, intervals = np.full(count, -np.inf), np.zeros(count), np.full(count, -np.inf), 0
    for _ in range(DIVISIONS):
        for at, values in ((begin, first), (end, last)):
            k, most = values[:, :count].argmax(axis=0), values[:, :count].max(axis=0)
            found, when = np.maximum(found, most), np.where(most > found, at[k], when)
        h = end - begin
        B, P = np.empty((2, h.size, motion.robot.n + 1, 7))
        D = np.empty((h.size, 6, motion.robot.n))
        _link_bounds(motion.lengths, np.asarray(motion.robot.prismatic), left, h, D, B, P)
        bound = enclose(first, last, h, B, P, D).reshape(h.size, count)
        intervals += h.size
        close = np.where(found <= 1.0, np.minimum(found * (1.0 + excess), 1.0), found * (1.0 + excess))
        wide = (bound > close).any(axis=1) & (h > NARROWEST_SHARE * motion.knots[-1])
        if intervals > PEAK_INTERVALS:
            wide[:] = False
        proved = np.maximum(proved, bound[~wide].max(axis=0, initial=-np.inf))
        if not wide.any():
            break
        piece, h = np.repeat(piece[wide], DIVIDED), h[wide]
        cuts = begin[wide, None] + h[:, None] * np.arange(DIVIDED + 1) / DIVIDED
        cuts[:, -1] = end[wide]
        inner = motion.joints_at(piece.reshape(-1, DIVIDED)[:, 1:].ravel(), cuts[:, 1:-1].ravel())
        values = evaluate(inner).reshape(h.size, DIVIDED - 1, -1)
        left = np.concatenate([left[wide][:, None], inner.reshape(h.size, DIVIDED - 1, *left.shape[1:])], axis=1)
        left = left.reshape(-1, *left.shape[2:])
        ends = np.concatenate([first[wide][:, None], values, last[wide][:, None]], axis=1)
        first, last = (np.ascontiguousarray(x.reshape(-1, x.shape[2])) for x in (ends[:, :-1], ends[:, 1:]))
        begin, end = cuts[:, :-1].ravel(), cuts[:, 1:].ravel()
    return np.maximum(proved, found), when


@compiled
def _link_bounds(lengths: Array, prismatic: Flags, joints: Array, h: Array, D: Array, B: Array, P: Array) -> None:
    """Write the bounds of `joint_bounds` and `link_bounds` over [0, h] from the derivatives (k, 6, n) at its beginning."""
    for k in range(h.shape[0]):
        joint_bounds(joints[k], h[k], D[k])
        link_bounds(lengths, prismatic, D[k], B[k], P[k])
