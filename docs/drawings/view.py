"""View: a parallel projection from the arm's base frame onto the sheet, with up against gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optik.types import Array

AZIMUTH, ELEVATION = np.radians(-52.0), np.radians(24.0)
"""Azimuth of the viewer about the vertical from the base's x axis, and elevation [rad]: no axis of an arm hides another one."""


@dataclass(frozen=True, eq=False)
class View:
    """A projection of points [m] to the sheet [px].

    Attributes
    ----------
    right, upwards, towards : (3,) arrays
        Directions of the sheet to the right and upwards, and from it to the viewer, in the base frame [1].
    up : (3,) array
        Direction against gravity [1].
    level : (2, 3) array
        Two horizontal directions [1].
    scale : float
        Pixels per metre.
    offset : (2,) array
        Position of the base's origin on the sheet [px].
    """

    right: Array
    upwards: Array
    towards: Array
    up: Array
    level: Array
    scale: float = 1.0
    offset: Array | tuple[float, float] = (0.0, 0.0)

    def __call__(self, points: ArrayLike) -> Array:
        """Return the projections of points."""
        points = np.asarray(points, dtype=np.float64)
        flat = np.stack([points @ self.right, -(points @ self.upwards)], axis=-1)
        return np.asarray(flat * self.scale + np.asarray(self.offset))

    def depth(self, points: ArrayLike) -> Array:
        """Return the distances of points towards the viewer, the order of drawing."""
        return np.asarray(np.asarray(points) @ self.towards)


def make_view(gravity: Array, azimuth: float = AZIMUTH, elevation: float = ELEVATION) -> View:
    """Return the view of an upright viewer beside the arm."""
    up = -np.asarray(gravity, dtype=np.float64)
    axis = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = axis - (axis @ up) * up
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    level = np.cos(azimuth) * first + np.sin(azimuth) * second
    towards = np.cos(elevation) * level + np.sin(elevation) * up
    right = np.cross(up, level)
    return View(right, np.cross(towards, right), towards, up, np.stack([first, second]))


def fit_view(view: View, points: ArrayLike, box: tuple[float, float, float, float]) -> View:
    """Return the view whose points fill a box of the sheet, centred."""
    left, top, width, height = box
    plain = View(view.right, view.upwards, view.towards, view.up, view.level)
    flat = plain(points)
    low, high = flat.min(axis=0), flat.max(axis=0)
    scale = float(np.min(np.array([width, height]) / np.maximum(high - low, 1e-9)))
    offset = np.array([left + width / 2, top + height / 2]) - scale * (low + high) / 2
    return View(view.right, view.upwards, view.towards, view.up, view.level, scale, offset)
