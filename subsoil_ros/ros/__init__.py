"""ROS 2 nodes of a run: they convert, delegate and publish. The only place that knows rclpy."""
