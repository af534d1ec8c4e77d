"""Limit on the tilt and the acceleration of a tray: an object that stands on it neither slips nor tips."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from optik.errors import InvalidInput
from planners.limits._specific_force import TiltLimit
from planners.limits.record import Record, check_optional, check_place


@dataclass(frozen=True)
class Tray(Record):
    """An object on a tray; at least one of friction and slenderness is given.

    Parameters
    ----------
    friction : float, optional
        Coefficient μ of friction [1]: the object slips from an angle of atan μ on.
    slenderness : float, optional
        Height of the centre of mass over the least distance of the foot's edge [1]: it tips from an angle of
        atan 1 / slenderness on.
    axis : (3,) or str
        The axis that points up, in the tool's frame; or a name such as ``"-z"``.
    com : (3,) array, optional
        Centre of mass in the tool's frame [m]; by default the payload's, or the tool's point.
    """

    friction: float | None = field(default=None, metadata={"unit": "1"})
    slenderness: float | None = field(default=None, metadata={"unit": "1"})
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    com: tuple[float, float, float] | None = field(default=None, metadata={"unit": "m"})

    def __post_init__(self) -> None:
        for name in ("friction", "slenderness"):
            object.__setattr__(self, name, check_optional(getattr(self, name), f"tray.{name}", "1"))
        if self.friction is None and self.slenderness is None:
            raise InvalidInput("tray", "neither friction nor slenderness", "at least one of them")
        check_place(self, "tray")

    @property
    def largest_angle(self) -> float:
        """The greatest angle between the apparent gravity and the axis [rad]."""
        ratios = [
            x for x in (self.friction, None if self.slenderness is None else 1.0 / self.slenderness) if x is not None
        ]
        return float(np.arctan(min(ratios)))

    def scaled(self, factor: float) -> Tray:
        """Return the tray with its greatest angle multiplied by a factor.

        Parameters
        ----------
        factor : float
            The factor [1].

        Returns
        -------
        Tray
        """
        most = np.tan(factor * self.largest_angle)
        friction = None if self.friction is None else float(most)
        return replace(self, friction=friction, slenderness=None if self.slenderness is None else float(1.0 / most))


class TrayLimit(TiltLimit):
    """The apparent gravity stays within the angle at which the object slips or tips."""

    name: ClassVar[str] = "tray"
    record: ClassVar[Any] = Tray


METHOD = TrayLimit
