"""Fits of soil to runs: the reduced soil to runs with particles, laws of particles to soil tests."""
