"""Greatest jerk of every joint."""

from __future__ import annotations

from typing import ClassVar

from planners.limits._joint import DerivativeLimit


class Jerk(DerivativeLimit):
    """Greatest jerk of every joint."""

    name: ClassVar[str] = "jerk"
    units: ClassVar[tuple[str, str]] = ("rad/s³", "m/s³")
    order: ClassVar[int] = 3


METHOD = Jerk
