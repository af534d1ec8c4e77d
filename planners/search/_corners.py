"""Compiled proof of how far the corners of a path may be cut."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.types import Array
from planners.search._edges import Body, Work, find_unproved

CORNER_HALVINGS, MOST_SLABS = 10, 8
"""How often the length that is cut from a corner is halved before it counts as 0, and the most parts of a triangle's proof."""


@compiled
def prove_corner(body: Body, a: Array, v: Array, b: Array, work: Work) -> float:
    """Return the greatest proved fraction of a corner: the triangle between the vertex v and the points on its edges is free.

    The fraction of the points a and b (n,) is 1; they are at equal distances before and behind the vertex [rad, m]. The
    result is 0 if no fraction is proved.
    """
    # A slab of the triangle parallel to a–b is within half its height of its middle line, as long as its lower side. The height
    # is along the triangle's axis, so it bounds the deviation of each joint.
    n, fraction = v.shape[0], 1.0
    first, last, deviation = np.empty(n), np.empty(n), np.empty(n)
    for _ in range(CORNER_HALVINGS):
        slabs = 1
        while slabs <= MOST_SLABS:
            k = slabs - 1
            while k >= 0:
                middle, low = fraction * (k + 0.5) / slabs, fraction * (k + 1.0) / slabs
                for j in range(n):
                    axis, half = 0.5 * (a[j] + b[j]) - v[j], 0.5 * (b[j] - a[j])
                    first[j], last[j] = v[j] + middle * axis - low * half, v[j] + middle * axis + low * half
                    deviation[j] = 0.5 * fraction * abs(axis) / slabs
                if find_unproved(body, first, last, deviation, work) >= 0:
                    break
                k -= 1
            if k < 0:
                return fraction
            slabs *= 2
        fraction *= 0.5
    return 0.0
