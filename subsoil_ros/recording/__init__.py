"""Bags: records to and from messages, MCAP writer, reader and recovery. Knows no rclpy."""
