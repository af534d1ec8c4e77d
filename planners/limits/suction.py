"""Limit for an object that hangs at a suction cup: it neither slips nor comes off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from optik.types import Array
from planners.limits._specific_force import split_by_axis
from planners.limits.grip import FrictionHold, FrictionHoldLimit


@dataclass(frozen=True)
class Suction(FrictionHold):
    """A suction cup.

    Parameters
    ----------
    friction : float
        Coefficient μ of friction between the cup and the object [1].
    force : float
        Force F with which the vacuum presses the object to the cup [N].
    mass : float, optional
        Mass of the object [kg]; by default the payload's, of an interval the heaviest.
    axis : (3,) or str
        The axis from the cup to the object, in the tool's frame; or its name.
    com : (3,) array, optional
        Centre of mass of the object in the tool's frame [m]; by default the payload's, or the tool's point.
    """


class SuctionLimit(FrictionHoldLimit):
    """m |f_t| ≤ μ (F − m f_n), where f_n pulls the object from the cup."""

    name: ClassVar[str] = "suction"
    record: ClassVar[Any] = Suction

    def faces(self, limit: Suction, mass: float, around: Array) -> tuple[Array, Array]:
        """Return the faces of the cone whose tip is F / m."""
        return around / limit.friction + self.axis(limit), np.full(around.shape[1], limit.force / mass)

    def measure(self, limit: Suction, mass: float, f: Array, off: Array | float = 0.0) -> Array:
        """Return m (|f_t| / μ + f_n) / F."""
        along, across = split_by_axis(f, self.axis(limit))
        steep = np.hypot(1.0, 1.0 / limit.friction)
        return np.asarray(mass / limit.force * np.maximum(across / limit.friction + along + steep * off, 0.0))


METHOD = SuctionLimit
