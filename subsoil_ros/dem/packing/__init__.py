"""Packing: how the particles of a bed are placed and brought to rest before a run."""
