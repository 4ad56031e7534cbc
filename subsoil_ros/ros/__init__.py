"""ROS 2 nodes of a run: they convert, delegate and publish. The only package that imports rclpy."""
