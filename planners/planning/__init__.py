"""The planner of one motion, and its result."""

from planners.motion import PlanStatus
from planners.planning.result import Plan

__all__ = ["Plan", "PlanStatus"]
