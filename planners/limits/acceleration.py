"""Greatest acceleration of every joint."""

from __future__ import annotations

from typing import ClassVar

from planners.limits._joint import DerivativeLimit


class Acceleration(DerivativeLimit):
    """Greatest acceleration of every joint."""

    name: ClassVar[str] = "acceleration"
    units: ClassVar[tuple[str, str]] = ("rad/s²", "m/s²")
    order: ClassVar[int] = 2
    sided: ClassVar[bool] = True


METHOD = Acceleration
