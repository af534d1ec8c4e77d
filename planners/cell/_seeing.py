"""Where a laser unit says that a spot is, of one reading or of several."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from optik.check import shown
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Plane, Sighting, Spot


def seen_from(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> Sighting:
    """Where a unit says that a spot is: the mean of its readings."""
    rows = _rows(spot, plane)
    found = []
    for row in rows.tolist():
        seen = _sighted(unit, row, plane)
        if not seen:
            return seen
        found.append(seen)
    if len(found) == 1:
        return found[0]
    mean = unit.angles(np.mean(np.stack([seen.point for seen in found if seen.point is not None]), axis=0))
    # the noise of the readings averages out, the calibration's error does not
    noise = _sighted(unit.with_pose(unit.pose), rows[0].tolist(), plane).covariance
    if not mean or noise is None or found[0].covariance is None:
        return mean
    return replace(mean, covariance=found[0].covariance - noise * (1.0 - 1.0 / len(found)))


def _rows(spot: Spot, plane: Plane | None) -> Array:
    """Readings (k, 3), checked; on a plane the range does not count."""
    try:
        rows: Array = np.atleast_2d(np.stack(np.broadcast_arrays(*(np.asarray(x, float) for x in spot)), axis=-1))
    except (TypeError, ValueError):
        raise InvalidInput("spot", shown(spot), "pan, tilt [rad] and range [m]") from None
    if rows.ndim != 2 or not len(rows):
        raise InvalidInput("spot", f"readings of shape {rows.shape[:-1]}", "one reading, or arrays (k,) of several")
    for name, values in zip(Spot._fields, rows.T, strict=True):
        if not np.isfinite(values).all() and (plane is None or name != "range"):
            raise InvalidInput("spot", f"{name} = {values[~np.isfinite(values)][0]}", "finite pan, tilt and range")
    return rows


def _sighted(unit: PanTiltLaser, row: list[float], plane: Plane | None) -> Sighting:
    """Where a unit says that a spot is, by one reading."""
    pan, tilt, distance = row
    return unit.angles(unit.point(pan, tilt, distance)) if plane is None else unit.on_plane(pan, tilt, plane)


def reading_variance(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> float:
    """Variance of a measured point by the noise of its readings alone, summed over the three axes."""
    rows = _rows(spot, plane)
    covariance = _sighted(unit.with_pose(unit.pose), rows[0].tolist(), plane).covariance
    return 0.0 if covariance is None else float(np.trace(covariance)) / len(rows)


def meant(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> Array:
    """Where the beam of a unit points with a reading, or the mean of several, whatever the unit's limits."""
    if plane is None:
        points: Array = np.atleast_2d(unit.point(*spot)).mean(axis=0)
        return points
    seen = seen_from(unit, spot, plane)
    if seen.point is None:
        raise InvalidInput("spot", f"one that the true unit does not see: {seen.reason}", "a beam that meets the plane")
    return seen.point
