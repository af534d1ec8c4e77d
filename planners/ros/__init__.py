"""ROS 2: trajectory messages, and the transports to a controller (rosbridge, rclpy). ROS itself is needed for rclpy only."""
