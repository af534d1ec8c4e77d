"""Messages for ROS 2: the message as data and text, the instants of its points, and what its controller makes of them."""
