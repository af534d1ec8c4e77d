"""Limit on the torque rates of motors that move several axes."""

from typing import ClassVar

from planners.limits._motor_torque import MotorTorqueLimit


class MotorTorqueRate(MotorTorqueLimit):
    """Limit on the torque rates of the motors of an arm."""

    name: ClassVar[str] = "motor_torque_rate"
    units: ClassVar[tuple[str, str]] = ("N·m/s", "N/s")
    order: ClassVar[int] = 3
    rate: ClassVar[bool] = True


METHOD = MotorTorqueRate
