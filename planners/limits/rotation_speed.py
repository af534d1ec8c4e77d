"""Greatest speed of the tool's rotation."""

from __future__ import annotations

from typing import ClassVar

from planners.limits._tool import ToolSpeedLimit


class RotationSpeed(ToolSpeedLimit):
    """Greatest speed |ω| of the tool's rotation."""

    name: ClassVar[str] = "rotation_speed"
    units: ClassVar[tuple[str, str]] = ("rad/s", "rad/s")
    part: ClassVar[int] = 1


METHOD = RotationSpeed
