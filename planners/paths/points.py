"""The points of another path, with one orientation."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from optik.types import Array
from planners.paths.base import Path
from planners.paths.stretch import Stretch


class PointsOf(Stretch):
    """The points of a whole path whose rotation is not asked, with one rotation (3, 3) along all of it; no file keeps it."""

    name: ClassVar[str] = "points"

    def __init__(self, path: Path, rotation: Array) -> None:
        super().__init__(path, 0.0, path.end)
        self.rotation = rotation

    def _evaluate(self, x: Array, order: int) -> Array:
        return without_rotation(super()._evaluate(x, order), self.rotation)

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) for each piece between breaks, 0 for the rotation."""
        return np.asarray(super().piece_bounds() * np.array([[1.0], [0.0]]))


def without_rotation(values: Array, rotation: Array) -> Array:
    """Return poses (k, 4, 4) with one rotation (3, 3), or twists (..., 6) without their rotation."""
    out = np.array(values, order="C")
    if out.shape[-1] == 4:
        out[..., :3, :3] = rotation
    else:
        out[..., 3:] = 0.0
    return out
