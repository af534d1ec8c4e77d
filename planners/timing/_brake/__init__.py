"""Brake a running motion as hard as its limits allow."""

from planners.timing._brake.brake import BrakingMotion, brake, stop_time

__all__ = ["BrakingMotion", "brake", "stop_time"]
