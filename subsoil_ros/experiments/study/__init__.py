"""What accuracy costs: presets of a scene against a finest run."""
