"""Greatest speed of the tool's rotation."""

from __future__ import annotations

from typing import ClassVar

from planners.certificate.analysis import MotionAnalysis
from planners.limits._tool import ToolSpeedLimit


class RotationSpeed(ToolSpeedLimit):
    """Greatest speed |ω| of the tool's rotation."""

    name: ClassVar[str] = "rotation_speed"
    units: ClassVar[tuple[str, str]] = ("rad/s", "rad/s")
    part: ClassVar[slice] = slice(3, 6)

    def _proved(self, motion: MotionAnalysis) -> tuple[float, float]:
        return motion.tool_speed.rotation, motion.tool_speed.t_rotation


METHOD = RotationSpeed
