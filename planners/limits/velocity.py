"""Greatest velocity of every joint."""

from __future__ import annotations

from typing import ClassVar

from planners.limits._joint import DerivativeLimit


class Velocity(DerivativeLimit):
    """Greatest velocity of every joint."""

    name: ClassVar[str] = "velocity"
    units: ClassVar[tuple[str, str]] = ("rad/s", "m/s")
    order: ClassVar[int] = 1
    sided: ClassVar[bool] = True


METHOD = Velocity
