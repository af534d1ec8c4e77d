"""The parts of a cell that a task works with: arm, drive, limits, scene, laser units, frames and readings."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.robot import Robot
from optik.check import check_count, format_value
from optik.errors import InvalidInput
from optik.scene import Scene
from optik.types import Array
from planners.cell.drives.base import Drive
from planners.cell.gripper import Gripper
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Look, Plane, Sighting, SimulatedSpot, Spot, check_vectors
from planners.limits import MotionLimits

MOST_READINGS = 10_000
"""Largest number of readings of one point; their mean has a hundredth of the noise."""


class CellParts:
    """The base class of `Cell`: its parts, its frames and the readings of its laser unit."""

    robot: Robot
    drive: Drive
    limits: MotionLimits
    scene: Scene | None
    gripper: Gripper | None

    def __init__(self, laser: PanTiltLaser, unit: PanTiltLaser, base: ArrayLike, seed: int) -> None:
        check_count(seed, "seed", 0)
        self.laser, self.unit, self.base = laser, unit, se3.check_pose(base, "base")
        self._rng = np.random.default_rng(seed)

    @property
    def notes(self) -> list[str]:
        """Remarks on the cell in every outcome."""
        massless = self.robot.inertia is None and self.gripper is not None
        note = f"the masses of {self.robot.name} are unknown: the mass of the gripper is not included"
        return [note] if massless else []

    def with_base(self, base: ArrayLike) -> Self:
        """Return the cell on a platform at another pose, with the same arm, drive and laser."""
        there = copy.copy(self)
        there.base = se3.check_pose(base, "base")
        return there

    def from_world(self, points: ArrayLike) -> Array:
        """Return points of the world in the arm's base frame."""
        local: Array = (check_vectors(points, "points") - self.base[:3, 3]) @ self.base[:3, :3]
        return local

    def read(self, point: ArrayLike, readings: int = 1) -> Spot:
        """Return a noisy reading by the true unit; it carries the true point, for simulations."""
        check_count(readings, "readings", 1, MOST_READINGS)
        true = check_vectors(point, "point")
        spot = SimulatedSpot(*self._read(true, readings))
        spot.true_point = true
        return spot

    def _read(self, true: Array, readings: int) -> Spot:
        return self.unit.read(true if readings == 1 else np.tile(true, (readings, 1)), self._rng)

    def truth(self, spot: Spot, plane: Plane | None = None) -> tuple[Array, bool]:
        """Return the true point of a reading, and whether it is known.

        If it is not known, the reading is taken as exact: the mean of its points, without the limits of the unit.
        """
        if isinstance(spot, SimulatedSpot) and spot.true_point is not None:
            return spot.true_point, True
        if plane is None:
            return np.atleast_2d(self.unit.point(*spot)).mean(axis=0), False
        seen = locate_spot(self.unit, spot, plane)
        if seen.point is None:
            wanted = "a beam of the true unit that meets the plane"
            raise InvalidInput("spot", f"a reading off the plane: {seen.reason}", wanted)
        return seen.point, False

    def sighting(self, spot: Spot, plane: Plane | None = None) -> Sighting:
        """Return the spot as the calibrated unit locates it: the mean of its readings."""
        return locate_spot(self.laser, spot, plane)

    def noise(self, spot: Spot, plane: Plane | None = None) -> float:
        """Return the variance of a measured point by the noise of its readings alone, summed over the three axes."""
        rows = _rows(spot, plane)
        covariance = _locate_reading(self.laser.with_pose(self.laser.pose), rows[0].tolist(), plane).covariance
        return 0.0 if covariance is None else float(np.trace(covariance)) / len(rows)

    def read_tool(self, tool: Array, readings: int, look: Look | None) -> Spot | Sighting:
        """Return a reading of the tool, or the failed sighting if the true unit cannot see it."""
        if look is not None:
            return look()
        visible = self.unit.angles(tool)
        return self._read(tool, readings) if visible else visible


def locate_spot(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> Sighting:
    """Return the spot as a unit locates it: the mean of its readings."""
    rows = _rows(spot, plane)
    sightings = []
    for row in rows.tolist():
        seen = _locate_reading(unit, row, plane)
        if not seen:
            return seen
        sightings.append(seen)
    if len(sightings) == 1:
        return sightings[0]
    mean = unit.angles(np.mean(np.stack([seen.point for seen in sightings if seen.point is not None]), axis=0))
    # The noise of the readings averages out; the error of the calibration does not.
    noise = _locate_reading(unit.with_pose(unit.pose), rows[0].tolist(), plane).covariance
    if not mean or noise is None or sightings[0].covariance is None:
        return mean
    return replace(mean, covariance=sightings[0].covariance - noise * (1.0 - 1.0 / len(sightings)))


def _rows(spot: Spot, plane: Plane | None) -> Array:
    """Return the checked readings (k, 3) [rad, rad, m]; on a plane the range is not used."""
    try:
        rows: Array = np.atleast_2d(np.stack(np.broadcast_arrays(*(np.asarray(x, float) for x in spot)), axis=-1))
    except (TypeError, ValueError):
        raise InvalidInput("spot", format_value(spot), "pan, tilt [rad] and range [m]") from None
    if rows.ndim != 2 or not len(rows):
        raise InvalidInput("spot", f"readings of shape {rows.shape[:-1]}", "one reading, or arrays (k,) of several")
    for name, values in zip(Spot._fields, rows.T, strict=True):
        if not np.isfinite(values).all() and (plane is None or name != "range"):
            raise InvalidInput("spot", f"{name} = {values[~np.isfinite(values)][0]}", "finite pan, tilt and range")
    return rows


def _locate_reading(unit: PanTiltLaser, row: list[float], plane: Plane | None) -> Sighting:
    """Return the spot as a unit locates it by one reading."""
    pan, tilt, distance = row
    return unit.angles(unit.point(pan, tilt, distance)) if plane is None else unit.intersect_plane(pan, tilt, plane)
