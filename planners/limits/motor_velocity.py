"""Limit on the velocities of motors that move several axes, or of other combinations of joints."""

from typing import ClassVar

from planners.limits._combination import CombinationLimit


class MotorVelocity(CombinationLimit):
    """Limit on the velocities of combinations of joints."""

    name: ClassVar[str] = "motor_velocity"
    units: ClassVar[tuple[str, str]] = ("rad/s", "m/s")
    order: ClassVar[int] = 1


METHOD = MotorVelocity
