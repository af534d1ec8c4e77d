"""Brake a running motion as hard as its limits allow."""

from planners.timing._brake.brake import Brake
from planners.timing._brake.rows import Course

__all__ = ["Brake", "Course"]
