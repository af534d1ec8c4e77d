"""Compiled RRT-Connect between a start and goals, and shortening of its paths; every edge is proved free."""

from __future__ import annotations

from math import sqrt

import numpy as np

from optik.compiled import compiled, inlined
from optik.types import Array, Indices
from planners.search._edges import Body, Work, find_unproved

Trees = tuple[Array, Indices, Indices]
"""Two trees: configurations (2, most, n) [rad, m], parents (2, most), −1 for a root, and numbers of configurations (2,)."""


LOCAL = 0.3
"""Size of the box around a configuration from which a local sample is taken, as a fraction of the joints' ranges."""


@inlined
def _square(a: Array, b: Array) -> float:
    """Return the square of the distance of two configurations."""
    total = 0.0
    for j in range(a.shape[0]):
        total += (b[j] - a[j]) * (b[j] - a[j])
    return total


@inlined
def _find_nearest_node(trees: Trees, tree: int, q: Array) -> int:
    best, nearest = np.inf, 0
    for k in range(trees[2][tree]):
        square = _square(trees[0][tree, k], q)
        if square < best:
            best, nearest = square, k
    return nearest


@compiled
def connect(
    body: Body, trees: Trees, samples: Array, ranges: Array, local: bool, step: float, work: Work
) -> tuple[int, int, int]:
    """Grow a tree from the start and one from the goals towards samples, until they meet.

    This is RRT-Connect (Kuffner and LaValle 2000). Each sample extends the smaller tree by one step. Then the other tree grows
    towards the new configuration until an edge is not free. The first attempt grows from the nearest goal to the start. If
    `local`, every second sample is moved near a configuration of the smaller tree: in a narrow passage it grows only there.

    Shapes and units: samples (k, n) within ranges (2, n) [rad, m], step [rad, m].

    Returns the number of samples used, and the last configurations of both trees, which are equal; −1 if they do not meet.
    """
    nodes, parents, counts = trees
    most, exact = nodes.shape[1], work[1][3]  # accelerations of the joints, zero: no deviation from an edge
    for k in range(samples.shape[0]):
        tree = 0 if counts[0] <= counts[1] else 1
        grown, new, target = tree, -1, samples[k]
        if k == 0:
            tree, grown, new, target = 0, 1, 0, nodes[0, 0]
        elif local and k % 2 == 1:
            node = nodes[tree, k // 2 % counts[tree]]
            for j in range(target.shape[0]):
                x = node[j] + LOCAL * (target[j] - 0.5 * (ranges[0, j] + ranges[1, j]))
                target[j] = min(max(x, ranges[0, j]), ranges[1, j])
        near = _find_nearest_node(trees, grown, target)
        while near >= 0:
            at, length = counts[grown], sqrt(_square(nodes[grown, near], target))
            if new >= 0 and length == 0.0:
                return (k + 1, new, near) if tree == 0 else (k + 1, near, new)
            if at >= most:
                return k + 1, -1, -1
            fraction = step / length if length > step else 1.0
            for j in range(target.shape[0]):
                start = nodes[grown, near, j]
                nodes[grown, at, j] = target[j] if fraction == 1.0 else start + fraction * (target[j] - start)
            if length == 0.0 or find_unproved(body, nodes[grown, near], nodes[grown, at], exact, work) >= 0:
                break
            parents[grown, at], counts[grown] = near, at + 1
            near = at
            if new < 0:
                grown, new, target = 1 - tree, at, nodes[tree, at]
                near = _find_nearest_node(trees, grown, target)
    return samples.shape[0], -1, -1


def trace(trees: Trees, first: int, last: int) -> Array:
    """Return the path (k, n) from the start through configuration `first` of its tree, equal to `last` of the goals' tree."""
    nodes, parents, _counts = trees
    order: list[list[int]] = [[], []]
    for tree, k in ((0, first), (1, int(parents[1, last]))):
        while k >= 0:
            order[tree].append(k)
            k = int(parents[tree, k])
    return np.concatenate([nodes[0, order[0][::-1]], nodes[1, order[1]]])


@inlined
def _locate(path: Array, count: int, length: float, q: Array) -> int:
    """Write the point at a length along a path; return the number of the edge that it is on."""
    i, edge = 0, sqrt(_square(path[0], path[1]))
    while length > edge and i < count - 2:
        length -= edge
        i += 1
        edge = sqrt(_square(path[i], path[i + 1]))
    fraction = min(length / edge, 1.0) if edge > 0.0 else 0.0
    for j in range(q.shape[0]):
        q[j] = path[i, j] + fraction * (path[i + 1, j] - path[i, j])
    return i


@inlined
def _move_vertices(path: Array, first: int, count: int, by: int) -> None:
    """Move the vertices from `first` on to later places, or to earlier ones if `by` is below 0."""
    for m in range(count - first):
        k = count - 1 - m if by > 0 else first + m
        for j in range(path.shape[1]):
            path[k + by, j] = path[k, j]


@compiled
def shorten(body: Body, path: Array, count: int, draws: Array, work: Work) -> int:
    """Shorten a path by free straight motions between random points of it; first and last, remove vertices.

    Shapes and units: path (count + 2 rounds, n) [rad, m], overwritten, of which `count` are vertices; draws (rounds, 2) in
    [0, 1), two positions as fractions of the length.

    Returns the number of vertices that remain.
    """
    rounds, n, exact = draws.shape[0], path.shape[1], work[1][3]
    p, q = np.empty(n), np.empty(n)
    for r in range(-1, rounds + 1):
        if r < 0 or r == rounds:  # from each vertex the straight motion to the last one that is free
            i = 0
            while i < count - 2:
                for m in range(count - 1, i + 1, -1):
                    if find_unproved(body, path[i], path[m], exact, work) < 0:
                        _move_vertices(path, m, count, i + 1 - m)
                        count -= m - i - 1
                        break
                i += 1
            continue
        if count < 3:
            break
        total = 0.0
        for k in range(count - 1):
            total += sqrt(_square(path[k], path[k + 1]))
        i = _locate(path, count, total * min(draws[r, 0], draws[r, 1]), p)
        m = _locate(path, count, total * max(draws[r, 0], draws[r, 1]), q)
        if m > i and find_unproved(body, p, q, exact, work) < 0:
            _move_vertices(path, m + 1, count, 2 - (m - i))
            count += 2 - (m - i)
            for j in range(n):
                path[i + 1, j], path[i + 2, j] = p[j], q[j]
    return count
