"""Bonds between particles that break for good (scene.bonds)."""
