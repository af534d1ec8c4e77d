"""Limits of a motion: their kinds, each with its rows in time laws, its judgement and its key in files."""

from planners.limits.acceleration_by_velocity import AccelerationByVelocity
from planners.limits.base import Limit, ratio_to_limit, scale_of, sides, symmetric_limit
from planners.limits.grip import Grip
from planners.limits.inputs import Extreme, PathPoints, ToolExtreme
from planners.limits.kinds import (
    ALL_LIMITS,
    DERIVATIVES,
    FIELD_LIMITS,
    LOADED,
    TOOL_SPEEDS,
    DerivativeLimit,
    check_names,
    kind_of,
    limit_names,
    register,
)
from planners.limits.motion_limits import MotionLimits, check_path, tool_limits_at
from planners.limits.open_container import OpenContainer
from planners.limits.suction import Suction
from planners.limits.tray import Tray

SAME_SPEED = 1e-6
"""Relative change of a requested tool speed below which it counts as unchanged: times in whole nanoseconds change it."""

__all__ = [
    "ALL_LIMITS", "DERIVATIVES", "FIELD_LIMITS", "LOADED", "SAME_SPEED", "TOOL_SPEEDS", "AccelerationByVelocity",
    "DerivativeLimit", "Extreme", "Grip", "Limit", "MotionLimits", "OpenContainer", "PathPoints", "Suction",
    "ToolExtreme", "Tray", "check_names", "check_path", "kind_of", "limit_names", "ratio_to_limit", "register",
    "scale_of", "sides", "symmetric_limit", "tool_limits_at",
]  # fmt: skip
