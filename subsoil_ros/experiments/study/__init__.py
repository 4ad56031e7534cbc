"""What accuracy costs: presets of a scene against a reference run."""
