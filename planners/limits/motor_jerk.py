"""Limit on the jerks of motors that move several axes, or of other combinations of joints."""

from typing import ClassVar

from planners.limits._combination import CombinationLimit


class MotorJerk(CombinationLimit):
    """Limit on the jerks of combinations of joints."""

    name: ClassVar[str] = "motor_jerk"
    units: ClassVar[tuple[str, str]] = ("rad/s³", "m/s³")
    order: ClassVar[int] = 3


METHOD = MotorJerk
