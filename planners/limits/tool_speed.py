"""Greatest speed of the tool's point."""

from __future__ import annotations

from typing import ClassVar

from planners.limits._tool import ToolSpeedLimit


class ToolSpeed(ToolSpeedLimit):
    """Greatest speed |v| of the tool's point."""

    name: ClassVar[str] = "tool_speed"
    units: ClassVar[tuple[str, str]] = ("m/s", "m/s")
    part: ClassVar[int] = 0


METHOD = ToolSpeed
