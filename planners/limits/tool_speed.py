"""Greatest speed of the tool's point."""

from __future__ import annotations

from typing import ClassVar

from planners.certificate.analysis import MotionAnalysis
from planners.limits._tool import ToolSpeedLimit


class ToolSpeed(ToolSpeedLimit):
    """Greatest speed |v| of the tool's point."""

    name: ClassVar[str] = "tool_speed"
    units: ClassVar[tuple[str, str]] = ("m/s", "m/s")
    part: ClassVar[slice] = slice(0, 3)

    def _proved(self, motion: MotionAnalysis) -> tuple[float, float]:
        return motion.tool_speed.speed, motion.tool_speed.t_speed


METHOD = ToolSpeed
