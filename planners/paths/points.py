"""The points of another path, with one orientation."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array
from planners.paths.base import Path, PiecewisePath


class PointsOf(PiecewisePath):
    """The points of a path whose rotation is not asked, with one rotation (3, 3) along all of it; no file keeps it."""

    name: ClassVar[str] = "points"

    def __init__(self, path: Path, rotation: Array) -> None:
        self.given, self.rotation = path, rotation
        self.unit, self.segments = path.unit, path.segments

    @property
    def end(self) -> float:
        """Length of the given path [m, or rad]."""
        return self.given.end

    @property
    def breaks(self) -> Array:
        """Breaks of the given path."""
        return self.given.breaks

    def _evaluate(self, x: Array, order: int) -> Array:
        return without_rotation(self.given._evaluate(x, order), self.rotation)

    @cached_property
    def _bounds(self) -> Array:
        bounds = self.given.known_bounds.copy()
        bounds[:, 1] = 0.0
        return bounds

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) for each piece between breaks."""
        return self._bounds

    def to_dict(self) -> dict[str, Any]:
        """Return the data of the given path."""
        return self.given.to_dict()

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the points of the path that `to_dict` wrote."""
        from planners.paths import path_of

        return cls(path_of(data, robot), np.eye(3))


def without_rotation(values: Array, rotation: Array) -> Array:
    """Return poses (k, 4, 4) with one rotation (3, 3), or twists (..., 6) without their rotation."""
    out = np.array(values, order="C")
    if out.shape[-1] == 4:
        out[..., :3, :3] = rotation
    else:
        out[..., 3:] = 0.0
    return out
