"""Integration methods of the mechanism."""
