"""Soil-tool co-simulation: discrete-element soil and a planar machine in lockstep."""

__version__ = "0.1.0"
