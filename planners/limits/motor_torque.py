"""Limit on the torques of motors that move several axes."""

from typing import ClassVar

from planners.limits._motor_torque import MotorTorqueLimit


class MotorTorque(MotorTorqueLimit):
    """Limit on the torques of the motors of an arm."""

    name: ClassVar[str] = "motor_torque"
    units: ClassVar[tuple[str, str]] = ("N·m", "N")
    order: ClassVar[int] = 2
    rate: ClassVar[bool] = False


METHOD = MotorTorque
