"""Fits of soil: the wedge model to runs with particles, particles to a laboratory's values."""
