"""Limit for an object between two fingers: it does not slip, and they are not pushed open."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from optik.check import check_number
from optik.types import Array
from planners.limits._specific_force import SpecificForceLimit, split_by_axis
from planners.limits.record import Record, check_optional, check_place


@dataclass(frozen=True)
class FrictionHold(Record):
    """An object that is held by friction; see `Grip` and `Suction`."""

    friction: float = field(metadata={"unit": "1"})
    force: float = field(metadata={"unit": "N"})
    mass: float | None = field(default=None, metadata={"unit": "kg"})
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    com: tuple[float, float, float] | None = field(default=None, metadata={"unit": "m"})

    def __post_init__(self) -> None:
        name = type(self).__name__.lower()
        for key, unit in (("friction", "1"), ("force", "N")):
            value = check_number(getattr(self, key), f"{name}.{key}", f"a number above 0 [{unit}]", above=0.0)
            object.__setattr__(self, key, value)
        object.__setattr__(self, "mass", check_optional(self.mass, f"{name}.mass", "kg"))
        check_place(self, name)


class FrictionHoldLimit(SpecificForceLimit):
    """Base of the limits on an object that is held by friction."""

    def scaled(self, value: Any, factor: float) -> Any:
        """Return the record with its force multiplied by a factor."""
        return replace(value, force=factor * value.force)


@dataclass(frozen=True)
class Grip(FrictionHold):
    """A grip of two fingers.

    Parameters
    ----------
    friction : float
        Coefficient μ of friction between a finger and the object [1].
    force : float
        Force F with which each finger presses [N].
    mass : float, optional
        Mass of the object [kg]; by default the payload's, of an interval the heaviest.
    axis : (3,) or str
        The axis along which the fingers close, in the tool's frame; or its name.
    com : (3,) array, optional
        Centre of mass of the object in the tool's frame [m]; by default the payload's, or the tool's point.
    """

    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)


class GripLimit(FrictionHoldLimit):
    """m |f_t| ≤ 2 μ F across the axis of the fingers, and m |f_n| ≤ F along it."""

    name: ClassVar[str] = "grip"
    record: ClassVar[Any] = Grip

    def faces(self, limit: Grip, mass: float, around: Array) -> tuple[Array, Array]:
        """Return the faces across the axis, and the two along it."""
        n = np.broadcast_to(self.axis(limit), (len(around), 1, 3))
        most = limit.force / mass
        return np.concatenate([around, n, -n], axis=1), np.array(
            [2.0 * limit.friction * most] * around.shape[1] + [most] * 2
        )

    def measure(self, limit: Grip, mass: float, f: Array, off: Array | float = 0.0) -> Array:
        """Return the larger of both ratios."""
        along, across = split_by_axis(f, self.axis(limit))
        return mass / limit.force * np.maximum((across + off) / (2.0 * limit.friction), np.abs(along) + off)


METHOD = GripLimit
