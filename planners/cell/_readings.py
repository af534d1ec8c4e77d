"""Readings of a laser unit: made at a true point, averaged, and located."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from optik.check import check_count, format_value
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Plane, Sighting, SimulatedSpot, Spot

MOST_READINGS = 10_000
"""Largest number of readings of one point; their mean has a hundredth of the noise."""


def read_point(unit: PanTiltLaser, point: Array, readings: int, rng: np.random.Generator) -> SimulatedSpot:
    """Return a noisy reading of a true point (3,) by a unit, or arrays of several; it carries the point."""
    check_count(readings, "readings", 1, MOST_READINGS)
    spot = SimulatedSpot(*unit.read(point if readings == 1 else np.tile(point, (readings, 1)), rng))
    spot.true_point = point
    return spot


def find_truth(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> tuple[Array, bool]:
    """Return the true point of a reading, and whether it is known.

    If it is not known, the reading is taken as exact: the mean of its points, without the limits of the unit.
    """
    if isinstance(spot, SimulatedSpot) and spot.true_point is not None:
        return spot.true_point, True
    if plane is None:
        return np.atleast_2d(unit.point(*spot)).mean(axis=0), False
    seen = locate_spot(unit, spot, plane)
    if seen.point is None:
        wanted = "a beam of the true unit that meets the plane"
        raise InvalidInput("spot", f"a reading off the plane: {seen.reason}", wanted)
    return seen.point, False


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
    noise = _find_noise(unit, rows, plane)
    if not mean or noise is None or sightings[0].covariance is None:
        return mean
    return replace(mean, covariance=sightings[0].covariance - noise * (1.0 - 1.0 / len(sightings)))


def find_variance(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> float:
    """Return the variance of a measured point by the noise of its readings alone, summed over the three axes."""
    rows = _rows(spot, plane)
    noise = _find_noise(unit, rows, plane)
    return 0.0 if noise is None else float(np.trace(noise)) / len(rows)


def _find_noise(unit: PanTiltLaser, rows: Array, plane: Plane | None) -> Array | None:
    """Return the covariance (3, 3) of the first of some readings, without that of the unit's pose [m²]."""
    return _locate_reading(unit.with_pose(unit.pose), rows[0].tolist(), plane).covariance


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
