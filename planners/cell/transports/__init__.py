"""Ways to reach a controller of ROS 2: through rosbridge, or with rclpy of a sourced ROS."""

from planners.cell.transports.base import Goal, Reading, Transport
from planners.cell.transports.rclpy import RclpyTransport
from planners.cell.transports.rosbridge import RosbridgeTransport

__all__ = ["Goal", "RclpyTransport", "Reading", "RosbridgeTransport", "Transport"]
