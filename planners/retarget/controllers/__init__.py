"""Controllers that change or follow set-points: one file each, with its public source."""

from planners.retarget.controllers.franka import FrankaLimiter
from planners.retarget.controllers.ur import ServoJ

__all__ = ["FrankaLimiter", "ServoJ"]
