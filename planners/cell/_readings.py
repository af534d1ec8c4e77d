"""What a cell reads: the calibrated and the true laser unit, where the platform stands, and which points are known."""

from __future__ import annotations

import copy
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.check import check_count
from optik.types import Array
from planners.cell._checks import vectors
from planners.cell._seeing import meant, reading_variance, seen_from
from planners.cell._task import Look
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Plane, Sighting, Spot

MOST_KNOWN = 10_000
"""Readings whose true points are kept, the last ones."""


MOST_READINGS = 10_000
"""Largest number of readings of one point; their mean has a hundredth of the noise."""


class CellReadings:
    """The part of `Cell` that concerns readings and frames."""

    def __init__(self, laser: PanTiltLaser, unit: PanTiltLaser, base: ArrayLike, seed: int) -> None:
        check_count(seed, "seed", 0)
        self.laser, self.unit, self.base = laser, unit, se3.check_pose(base, "base")
        self._rng = np.random.default_rng(seed)
        self._known: dict[int, tuple[Spot, Array]] = {}

    def moved(self, base: ArrayLike) -> Self:
        """Return the same cell, its platform standing elsewhere; arm, drive and laser are the same."""
        there = copy.copy(self)
        there.base = se3.check_pose(base, "base")
        return there

    def from_world(self, points: ArrayLike) -> Array:
        """Return points of the world in the arm's base frame."""
        local: Array = (vectors(points, "points") - self.base[:3, 3]) @ self.base[:3, :3]
        return local

    def read(self, point: ArrayLike, readings: int = 1) -> Spot:
        """Return what the true unit reads of a true point, with its noise, for simulations."""
        check_count(readings, "readings", 1, MOST_READINGS)
        true = vectors(point, "point")
        spot = self._read(true, readings)
        self._known[id(spot)] = (spot, true)
        if len(self._known) > MOST_KNOWN:
            self._known.pop(next(iter(self._known)))
        return spot

    def _read(self, true: Array, readings: int) -> Spot:
        return self.unit.read(true if readings == 1 else np.tile(true, (readings, 1)), self._rng)

    def truth(self, spot: Spot, plane: Plane | None = None) -> tuple[Array, bool]:
        """Return where a spot truly is, and whether that is known."""
        if id(spot) in self._known:
            return self._known[id(spot)][1], True
        return meant(self.unit, spot, plane), False

    def sighting(self, spot: Spot, plane: Plane | None = None) -> Sighting:
        """Return where the calibrated unit says that a spot is: the mean of its readings."""
        return seen_from(self.laser, spot, plane)

    def noise(self, spot: Spot, plane: Plane | None = None) -> float:
        """Return the variance of a measured point by the noise of its readings alone, summed over the three axes."""
        return reading_variance(self.laser, spot, plane)

    def read_tool(self, tool: Array, readings: int, look: Look | None) -> Spot | Sighting:
        """Return a reading of the tool, or why the true unit cannot see it."""
        if look is not None:
            return look()
        visible = self.unit.angles(tool)
        return self._read(tool, readings) if visible else visible
