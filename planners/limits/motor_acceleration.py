"""Limit on the accelerations of motors that move several axes, or of other combinations of joints."""

from typing import ClassVar

from planners.limits._combination import CombinationLimit


class MotorAcceleration(CombinationLimit):
    """Limit on the accelerations of combinations of joints."""

    name: ClassVar[str] = "motor_acceleration"
    units: ClassVar[tuple[str, str]] = ("rad/s²", "m/s²")
    order: ClassVar[int] = 2


METHOD = MotorAcceleration
