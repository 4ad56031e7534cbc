"""Stable soil steps and communication steps, derived from a scene."""
