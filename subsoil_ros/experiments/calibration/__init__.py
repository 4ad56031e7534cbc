"""Fits of soil to runs: the wedge model to runs with particles, laws of particles to soil tests."""
