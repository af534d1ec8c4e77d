"""Controllers that change or follow set-points: one file each, with its public source."""

from planners.streams.controllers.franka import FrankaLimiter
from planners.streams.controllers.ur import ServoJ

__all__ = ["FrankaLimiter", "ServoJ"]
