"""From a scene file to a resolved scene: presets, overrides, limits, messages about what is wrong."""
