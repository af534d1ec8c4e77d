"""Projection of a configuration onto a joint path."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik.types import Array
from planners.curve import Curve
from planners.following.joint_path import JointPath

BETWEEN_NODES = 4
"""Number of intervals between two nodes in which the nearest point is searched; in each the distance has one minimum."""
NEAR_INTERVALS = 8
"""Largest number of intervals that are searched if a path comes near a configuration more than once."""
EQUALLY_NEAR = 1e-6
"""Difference of distances [rad or m] below which two points of the path are equally near."""
PROJECTION_STEPS = 60
"""Number of search steps in an interval; enough for bisection alone."""


def find_nearest_s(joints: JointPath, q: ArrayLike, near: float) -> float:
    """Return the path parameter s nearest to a configuration (n,) [rad, m]; among equally near ones the closest to `near`."""
    q, part = np.asarray(q, dtype=np.float64), np.arange(BETWEEN_NODES) / BETWEEN_NODES
    grid = np.append((joints.nodes[:-1, None] + np.diff(joints.nodes)[:, None] * part).ravel(), joints.end)
    off = np.linalg.norm(joints(grid) - q, axis=1)
    lowest = np.flatnonzero((off <= np.append(off[1:], np.inf)) & (off <= np.append(np.inf, off[:-1])))
    chosen = lowest[np.argsort(off[lowest], kind="stable")][:NEAR_INTERVALS]
    minima = [find_nearest_between(joints, q, grid[max(i - 1, 0)], grid[min(i + 1, grid.size - 1)]) for i in chosen]
    distances = np.array([float(np.linalg.norm(joints(s) - q)) for s in minima])
    nearest = [s for s, d in zip(minima, distances, strict=True) if d <= distances.min() + EQUALLY_NEAR]
    return min(nearest, key=lambda s: abs(s - near))


def find_nearest_between(joints: Curve, q: Array, low: float, high: float) -> float:
    """Return s in [low, high] at which a curve is nearest to q, by Newton steps for q' · (q(s) − q) = 0, or by bisection."""
    s = 0.5 * (low + high)
    for _ in range(PROJECTION_STEPS):
        q1, off = joints(s, 1), joints(s) - q
        slope = float(q1 @ off)
        if slope > 0.0:
            high = s
        else:
            low = s
        size = float(q1 @ q1)
        after = s - slope / size if size > 0.0 else low - 1.0
        if not low <= after <= high:
            after = 0.5 * (low + high)
        if abs(after - s) <= 1e-15 * joints.end:
            return after
        s = after
    return s
