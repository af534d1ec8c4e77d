"""Brake a running motion as hard as its limits allow."""

from planners.timing.brake.brake import Brake, BrakingMotion
from planners.timing.brake.rows import RunningMotion

__all__ = ["Brake", "BrakingMotion", "RunningMotion"]
