"""Excess of a capsule, a proved bound of the distance of its surface from the enclosed mesh.

Cells along the meridian and around the axis cover the surface. The distance of any point of a cell from the mesh is at most
that of the cell's centre plus half the cell's extent. The bound is the largest such sum; cells that may contain the farthest
point are divided. Distances are measured to sampled points of the mesh, which can only make them larger.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from optik.types import Array

SPACING = 60
"""Number of sampled points of a mesh along its size."""

MOST_POINTS = 200_000
"""Most points on a mesh: with fewer than `SPACING` requires, the bound is larger, never too small."""

EXCESS_STEP = 5e-4
"""Accuracy of the bound [m]."""

MOST_OPEN_CELLS = 100_000
"""Most cells that are divided: beyond it, the bound is less accurate."""


CELLS = 16
"""Initial number of cells along the meridian of a capsule and around its axis."""


class Capsule(NamedTuple):
    """A capsule around a part of a mesh."""

    a: Array
    b: Array
    radius: float
    excess: float = np.nan

    def transform(self, T: Array) -> Capsule:
        """Return the capsule in another frame."""
        return self._replace(a=T[:3, :3] @ self.a + T[:3, 3], b=T[:3, :3] @ self.b + T[:3, 3])


def complete_frame(u: Array) -> tuple[Array, Array]:
    """Return two unit vectors that form an orthonormal frame with a unit vector."""
    x, y, z = u.tolist()
    least = int(np.argmin(np.abs(u)))
    v = np.array([(0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)][least])
    v /= np.sqrt(v @ v)
    a, b, c = v.tolist()
    return v, np.array([y * c - z * b, z * a - x * c, x * b - y * a])


def distance_to_segment(points: Array, a: Array, b: Array) -> Array:
    """Return the distances of points from a segment."""
    d = b - a
    length2 = float(d @ d)
    t = np.clip((points - a) @ d / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - (a + t[:, None] * d), axis=1))


def sample_points(triangles: Array) -> Any:
    """Return a k-d tree of points on triangles, dense enough for distances to the mesh."""
    from scipy.spatial import cKDTree

    size = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    points, todo = [triangles.reshape(-1, 3)], triangles
    count = len(points[0])
    while len(todo):
        edges = np.linalg.norm(todo - np.roll(todo, -1, axis=1), axis=2)
        todo = todo[edges.max(axis=1) > size / SPACING]
        count += len(todo)
        if count > MOST_POINTS or not len(todo):
            break
        longest = np.argmax(np.linalg.norm(todo - np.roll(todo, -1, axis=1), axis=2), axis=1)
        rows, order = np.arange(len(todo))[:, None], (longest[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(todo[rows, order], 1, 0)
        middle = 0.5 * (a + b)
        points.append(middle)
        todo = np.concatenate((np.stack((a, middle, c), axis=1), np.stack((middle, b, c), axis=1)))
    return cKDTree(np.concatenate(points))


def measure_excess(capsules: list[Capsule], tree: Any) -> list[Capsule]:
    """Return the capsules of a mesh with the bounds of their excess."""
    others = [capsules[:i] + capsules[i + 1 :] for i in range(len(capsules))]
    return [c._replace(excess=bound_excess(c, rest, tree)) for c, rest in zip(capsules, others, strict=True)]


def bound_excess(capsule: Capsule, others: list[Capsule], tree: Any, *, coarse: bool = False) -> float:
    """Bound the distance of a capsule's surface outside of the other capsules from the points of the mesh."""
    meridian = float(np.linalg.norm(capsule.b - capsule.a)) + np.pi * capsule.radius
    steps = (np.arange(CELLS) + 0.5) / CELLS
    s, phi = (grid.ravel() for grid in np.meshgrid(steps * meridian, steps * 2.0 * np.pi))
    ds, dphi, bound = meridian / CELLS, 2.0 * np.pi / CELLS, 0.0
    while len(s):
        place, across = _surface_points(capsule, s, phi)
        extent = 0.5 * ds + 0.5 * dphi * np.minimum(across + 0.5 * ds, capsule.radius)
        outside = np.ones(len(s), dtype=bool)
        for other in others:
            outside &= distance_to_segment(place, other.a, other.b) > other.radius - (0.0 if coarse else extent)
        s, phi, place, extent = s[outside], phi[outside], place[outside], extent[outside]
        distance = np.asarray(tree.query(place)[0]) if len(s) else np.zeros(0)
        if coarse:
            return float(distance.max(initial=0.0))
        open_ = distance + extent > max(float(distance.max(initial=0.0)), bound) + EXCESS_STEP
        if np.count_nonzero(open_) > MOST_OPEN_CELLS:
            open_[:] = False
        bound = max(bound, float((distance + extent)[~open_].max(initial=0.0)))
        ds, dphi = 0.5 * ds, 0.5 * dphi
        s = np.concatenate([s[open_] + 0.5 * i * ds for i in (-1, -1, 1, 1)])
        phi = np.concatenate([phi[open_] + 0.5 * i * dphi for i in (-1, 1, -1, 1)])
    return bound


def _surface_points(capsule: Capsule, s: Array, phi: Array) -> tuple[Array, Array]:
    """Return points of a capsule's surface, by meridian length and angle, and their distances from the axis."""
    r, d = capsule.radius, capsule.b - capsule.a
    length = float(np.linalg.norm(d))
    u = d / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    v, w = complete_frame(u)
    cap = 0.5 * np.pi * r
    angle = np.where(s < cap, s, np.where(s > cap + length, s - length, cap)) / r
    along = np.clip(s - cap, 0.0, length) - r * np.cos(angle)
    across = r * np.sin(angle)
    around = np.cos(phi)[:, None] * v + np.sin(phi)[:, None] * w
    return capsule.a + along[:, None] * u + across[:, None] * around, across
