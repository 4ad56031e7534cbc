"""From a scene file to a resolved scene: presets, overrides, limits, error messages."""
