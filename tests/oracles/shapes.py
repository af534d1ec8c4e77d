"""Distances of points from capsules, written out plainly."""

import numpy as np


def distances(points, a, b, radius):
    """Distances (k,) of points from a capsule; negative inside."""
    d = np.asarray(b) - a
    t = np.clip((points - a) @ d / max(d @ d, 1e-300), 0.0, 1.0)
    return np.linalg.norm(points - a - t[:, None] * d, axis=1) - radius
