"""Messages on the wire: codec, quality of service, ROS domains."""
