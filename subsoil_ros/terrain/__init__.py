"""Soil as a terrain that tools dig: a height field, what a bucket carries, forces of failing soil."""
