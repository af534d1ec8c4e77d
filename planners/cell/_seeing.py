"""Where a laser unit says that a spot is, of one reading or of several."""

from __future__ import annotations

import numpy as np

from optik.check import shown
from optik.errors import InvalidInput
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Plane, Sighting, Spot


def seen_from(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> Sighting:
    """Where a unit says that a spot is: the mean of its readings.

    Parameters
    ----------
    unit : PanTiltLaser
        The unit.
    spot : Spot
        A reading, or several.
    plane : Plane or None
        On which the spot is.

    Returns
    -------
    Sighting
        The point, or why there is none.

    Raises
    ------
    InvalidInput
        No reading, NaN in it, or a negative range.
    """
    try:
        rows = np.atleast_2d(np.stack(np.broadcast_arrays(*(np.asarray(x, float) for x in spot)), axis=-1))
    except (TypeError, ValueError):
        raise InvalidInput("spot", shown(spot), "pan, tilt [rad] and range [m]") from None
    for name, values in zip(Spot._fields, rows.T, strict=True):
        if not np.isfinite(values).all() and (plane is None or name != "range"):
            raise InvalidInput("spot", f"{name} = {values[~np.isfinite(values)][0]}", "finite pan, tilt and range")
    found = []
    for pan, tilt, distance in rows.tolist():
        seen = unit.angles(unit.point(pan, tilt, distance)) if plane is None else unit.on_plane(pan, tilt, plane)
        if not seen:
            return seen
        found.append(seen)
    if len(found) == 1:
        return found[0]
    return unit.angles(np.mean(np.stack([seen.point for seen in found if seen.point is not None]), axis=0))
