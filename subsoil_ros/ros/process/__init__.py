"""Nodes as processes and threads: start, supervision, heartbeat, signals."""
