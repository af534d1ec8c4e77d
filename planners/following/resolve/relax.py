"""Relaxation: the configurations of a sequence move along their self-motion manifolds until the motion is short."""

from __future__ import annotations

import numpy as np

from optik.types import Array
from planners.following.resolve.graph import Sequence
from planners.following.resolve.nodes import Sampler
from planners.paths.base import Path

SWEEPS, MOVED = 120, 3e-4
"""Most sweeps, and the largest motion of a joint [rad, m] in a sweep that ends them."""
WANTED_ROOM, KEPT_ROOM = 0.02, 0.5
"""A configuration keeps this room [m], or this fraction of the room that it has at first."""
REGULAR = 0.02
"""Smallest singular value up to which a configuration's own may not become less [m, 1]."""
LIMITS_PUSH, INSIDE = 0.02, 0.02
"""Step from the limits of a joint at one of them [rad, m], and the fraction of half its range that is kept from them: the curve
through the configurations overshoots."""
LONGEST_MOVE = 0.3
"""Longest motion of a joint in a sweep [rad, m]."""
LONGER, SHORTER = 1.5, 0.4
"""Factors of the step after one that was accepted, and after one that was not."""


def relax(sampler: Sampler, path: Path, given: list[Sequence], *, held: bool, caution: int = 0) -> list[Sequence]:
    """Return shorter sequences: each configuration moves towards the mean of its neighbours, and stays inside and free.

    Each further degree of caution keeps it farther from limits and contact.
    """
    if not given:
        return []
    s, q, limits = (
        np.concatenate([one.s for one in given]),
        np.concatenate([one.q for one in given]),
        sampler.arm.limits,
    )
    row, last = (np.concatenate([np.arange(len(one.s))[::way] for one in given]) for way in (1, -1))  # from both ends
    (sigma, sides), regular = sampler.regularity(q), REGULAR * (1 + caution)
    poses, step = np.ascontiguousarray(path.pose(s)), np.ones(len(q))
    pad = INSIDE * (1 + caution) * np.where(limits.bounded, limits.half, 0.0)
    push, wanted = LIMITS_PUSH * 3.0**caution, WANTED_ROOM * (1 + caution)
    floor = np.minimum(KEPT_ROOM * sampler.rooms(q), wanted)

    def outside(x: Array) -> Array:
        return np.maximum(np.maximum(limits.lower + pad - x, x - limits.upper + pad), 0.0)

    for _ in range(SWEEPS):
        moved = 0.0
        for parity in (0, 1):
            k = np.flatnonzero((row % 2 == parity) & ((row > 0) | (not held)))
            below, above = np.sign(row[k]), np.sign(last[k])  # an end has one neighbour
            left, right = k + np.where(below, -1, above), k + np.where(above, 1, -below)
            u = np.where(left < right, (s[k] - s[left]) / np.where(left < right, s[right] - s[left], 1.0), 0.0)[:, None]
            to = step[k, None] * ((1.0 - u) * q[left] + u * q[right] - q[k])
            on, ok = sampler.project_slowly(q[k] + to - push * limits.normalise(q[k]) ** 7, poses[k])
            room = np.full(len(k), -1.0)
            room[ok] = sampler.rooms(on[ok])
            ok &= (room > 0.0) & (room >= floor[k])
            ok &= (np.abs(on - q[k]).max(axis=1) < LONGEST_MOVE) & (outside(on) <= outside(q[k]) + 1e-12).all(axis=1)
            sigma_on, sides_on = sampler.regularity(on)
            ok &= (sides_on == sides[k]) & (sigma_on >= np.minimum(sigma[k], regular))
            moved = max(moved, float(np.abs(on[ok] - q[k][ok]).max(initial=0.0)))
            q[k[ok]], sigma[k[ok]] = on[ok], sigma_on[ok]
            step[k] = np.where(ok, np.minimum(1.0, LONGER * step[k]), SHORTER * step[k])
        if moved < MOVED:
            break
    ends = np.flatnonzero(last == 0)[:-1] + 1
    return [Sequence(*pair) for pair in zip(np.split(s, ends), np.split(q, ends), strict=True)]
