"""Brake a running motion as hard as its limits allow."""

from planners.timing._brake.brake import Braking, brake, stop_time

__all__ = ["Braking", "brake", "stop_time"]
