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
    """The part of `Cell` that concerns readings and frames.

    Parameters
    ----------
    laser, unit : PanTiltLaser
        The unit as it was calibrated, and the true one.
    base : (4, 4) array
        T_world_platform [1, m].
    seed : int
        Of the readings' noise.

    Raises
    ------
    InvalidInput
        A base that is no pose, or a seed below 0.
    """

    def __init__(self, laser: PanTiltLaser, unit: PanTiltLaser, base: ArrayLike, seed: int) -> None:
        check_count(seed, "seed", 0)
        self.laser, self.unit, self.base = laser, unit, se3.check_pose(base, "base")
        self._rng = np.random.default_rng(seed)
        self._known: dict[int, tuple[Spot, Array]] = {}

    def moved(self, base: ArrayLike) -> Self:
        """Return the same cell, its platform standing elsewhere; arm, drive and laser are the same.

        Parameters
        ----------
        base : (4, 4) array
            T_world_platform [1, m].

        Returns
        -------
        Cell
            The cell there.

        Raises
        ------
        InvalidInput
            Not a pose.
        """
        there = copy.copy(self)
        there.base = se3.check_pose(base, "base")
        return there

    def from_world(self, points: ArrayLike) -> Array:
        """Return points of the world in the arm's base frame.

        Parameters
        ----------
        points : (3,) or (..., 3) array
            In the world [m].

        Returns
        -------
        (3,) or (..., 3) array
            In the base frame [m].

        Raises
        ------
        InvalidInput
            Wrong shape, NaN or infinity.
        """
        local: Array = (vectors(points, "points") - self.base[:3, 3]) @ self.base[:3, :3]
        return local

    def read(self, point: ArrayLike, readings: int = 1) -> Spot:
        """Return what the true unit reads of a true point, with its noise, for simulations.

        Parameters
        ----------
        point : (3,) array
            In the arm's base frame [m].
        readings : int
            How often it is read.

        Returns
        -------
        Spot
            The reading, or arrays (k,) of several [rad, rad, m]. A task with it knows where the spot truly is.

        Raises
        ------
        InvalidInput
            Wrong shape, NaN or infinity, no reading, or too many.
        """
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
        """Return where a spot truly is, and whether that is known.

        Parameters
        ----------
        spot : Spot
            A reading.
        plane : Plane, optional
            On which the spot is.

        Returns
        -------
        point : (3,) array
            The point that `read` was given; of another reading, where the true unit's beam points with it [m].
        known : bool
            Whether the reading was made by `read`.

        Raises
        ------
        InvalidInput
            A reading that is none, or whose beam does not meet the plane.
        """
        if id(spot) in self._known:
            return self._known[id(spot)][1], True
        return meant(self.unit, spot, plane), False

    def sighting(self, spot: Spot, plane: Plane | None = None) -> Sighting:
        """Return where the calibrated unit says that a spot is: the mean of its readings.

        Parameters
        ----------
        spot : Spot
            A reading, or several.
        plane : Plane, optional
            On which the spot is; the range is then not used.

        Returns
        -------
        Sighting
            The point, or why there is none.

        Raises
        ------
        InvalidInput
            No reading, or NaN in it.
        """
        return seen_from(self.laser, spot, plane)

    def noise(self, spot: Spot, plane: Plane | None = None) -> float:
        """Return the variance of a measured point by the noise of its readings alone, summed over the three axes.

        Parameters
        ----------
        spot : Spot
            A reading, or several.
        plane : Plane, optional
            On which the spot is.

        Returns
        -------
        float
            The variance [m²], by the stated noise of the calibrated unit.
        """
        return reading_variance(self.laser, spot, plane)

    def read_tool(self, tool: Array, readings: int, look: Look | None) -> Spot | Sighting:
        """Return a reading of the tool, or why the true unit cannot see it.

        Parameters
        ----------
        tool : (3,) array
            Where it truly is, for simulations [m].
        readings : int
            How often it is read; the mean counts.
        look : callable, optional
            Makes a reading of the real tool.

        Returns
        -------
        Spot or Sighting
            The reading; a sighting that is not found where the unit cannot see the tool.
        """
        if look is not None:
            return look()
        visible = self.unit.angles(tool)
        return self._read(tool, readings) if visible else visible
