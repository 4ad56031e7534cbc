"""Bags: records to and from messages, MCAP writer, reader and recovery. Imports no rclpy."""
