"""The positions of a motion on the chords of a path, as a whole: the cheapest sequence of adjacent chords."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.types import Array, Flags, Indices

CHORD_ROOM, ROOM_FACTOR = 1e-4, 8.0
"""First search distance of the tool from the path's chords [m], and its growth factor if the search fails."""
MOST_PAIRS = 4_000_000
"""Largest number of pairs of an instant and a chord; a motion that needs more is far from its path."""


def find_positions(edges: Array, z: Array, y: Array, off: float) -> Array | None:
    """Return the positions (k,) of a motion y (k, d) on chords z (m + 1, d), or None if the motion is far from them.

    `off` is the sum of the largest distances of the path and of the motion from their chords.
    """
    cell, room = np.empty(len(y), np.int64), CHORD_ROOM + 2.0 * off
    size = float(np.ptp(np.concatenate([z, y]), axis=0).sum())
    while True:
        found = _find_cheapest(z, y, room, MOST_PAIRS, cell)
        if found == FOUND:
            return _nearest_on_chords(edges, z, y, cell)
        if found == TOO_MANY or room > size:
            return None
        room *= ROOM_FACTOR


def _nearest_on_chords(edges: Array, z: Array, y: Array, cell: Indices) -> Array:
    """Return the path parameters (k,) on given chords that are nearest to points y."""
    a, e = z[cell], z[cell + 1] - z[cell]
    size = np.einsum("ij,ij->i", e, e)
    part = np.einsum("ij,ij->i", y - a, e) / np.where(size > 0.0, size, 1.0)
    return np.asarray(edges[cell] + np.clip(part, 0.0, 1.0) * (edges[cell + 1] - edges[cell]))


FOUND, TOO_FAR, TOO_MANY = range(3)
"""Results of the search: found, the motion is off its path, or too many pairs of an instant and a chord."""


@compiled
def _distance2(x: Array, a: Array, b: Array) -> float:
    """Return the squared distance of a point from the chord between two others."""
    along, size, off = 0.0, 0.0, 0.0
    for j in range(x.shape[0]):
        e, d = b[j] - a[j], x[j] - a[j]
        along += e * d
        size += e * e
        off += d * d
    if along <= 0.0 or size == 0.0:
        return off
    if along >= size:
        return max(off - 2.0 * along + size, 0.0)
    return max(off - along * along / size, 0.0)


@compiled
def _grow(x: Indices, count: int) -> Indices:
    """Return the array, copied into a larger one if it has fewer entries than `count`."""
    if count <= x.shape[0]:
        return x
    more = np.empty(2 * count, np.int64)
    for i in range(x.shape[0]):
        more[i] = x[i]
    return more


@compiled
def _find_cheapest(z: Array, y: Array, room: float, most: int, cell: Indices) -> int:
    """Find the chord of z (m + 1, d) for every point y (k, d), into cell (k,), by dynamic programming.

    A state is a chord within `room` of the point. From one point to the next it crosses only vertices within `room` of the
    segment between the points. A step forwards is free; a step backwards costs `room` times the chord's length.
    """
    m, k, limit = z.shape[0] - 1, y.shape[0], room * room
    cost, new, origin = np.full(m, np.inf), np.full(m, np.inf), np.empty(m, np.int64)
    near, touched = np.zeros(m + 1, np.bool_), np.empty(m, np.int64)
    cells, before = np.empty(4 * k + m, np.int64), np.empty(4 * k + m, np.int64)
    count = 0
    for i in range(m):
        d = _distance2(y[0], z[i], z[i + 1])
        if d <= limit:
            cost[i] = d
            cells[count], before[count] = i, -1
            count += 1
    first, last = 0, count
    for row in range(1, k):
        number = _find_touched(z, y[row - 1], y[row], limit, cells[first:last], near, touched)
        for j in range(first, last):
            i = cells[j]
            new[i], origin[i] = cost[i], j
        for j in range(1, number):
            i = touched[j]
            if near[i] and touched[j - 1] == i - 1 and new[i - 1] < new[i]:
                new[i], origin[i] = new[i - 1], origin[i - 1]
        for j in range(number - 2, -1, -1):
            i = touched[j]
            if near[i + 1] and touched[j + 1] == i + 1:
                back = new[i + 1] + room * np.sqrt(_distance2(z[i], z[i + 1], z[i + 1]))
                if back < new[i]:
                    new[i], origin[i] = back, origin[i + 1]
        cells, before = _grow(cells, count + number), _grow(before, count + number)
        first = count
        for j in range(number):
            i = touched[j]
            d = _distance2(y[row], z[i], z[i + 1])
            if d <= limit and new[i] < np.inf:
                cost[i] = new[i] + d
                cells[count], before[count] = i, origin[i]
                count += 1
            new[i], near[i], near[i + 1] = np.inf, False, False
        last = count
        if count > most:
            return TOO_MANY
        if first == last:
            return TOO_FAR
    return _trace_back(cost, cells[:last], before, first, cell)


@compiled
def _trace_back(cost: Array, cells: Indices, before: Indices, first: int, cell: Indices) -> int:
    """Trace the cheapest sequence of states back to the start and write it into `cell`; return TOO_FAR if there is none."""
    if first == cells.shape[0]:
        return TOO_FAR
    at, least = first, np.inf
    for j in range(first, cells.shape[0]):
        if cost[cells[j]] < least:
            at, least = j, cost[cells[j]]
    for row in range(cell.shape[0] - 1, -1, -1):
        cell[row] = cells[at]
        at = before[at]
    return FOUND


@compiled
def _find_touched(z: Array, a: Array, b: Array, limit: float, active: Indices, near: Flags, touched: Indices) -> int:
    """Write the chords that the segment from a to b can reach from the active ones, in order, into `touched`; return how many.

    near[i] is set if vertex i is within the limit of the segment.
    """
    m, number, next_free = z.shape[0] - 1, 0, 0
    for i in active:
        if i < next_free:
            continue
        low = i
        while low > next_free and _distance2(z[low], a, b) <= limit:
            near[low] = True
            low -= 1
        for j in range(low, i + 1):
            touched[number] = j
            number += 1
        next_free = i + 1
        while next_free < m and _distance2(z[next_free], a, b) <= limit:
            near[next_free] = True
            touched[number] = next_free
            number += 1
            next_free += 1
    return number
