"""Elastic spheres: Hertz along the normal, Mindlin along the tangent."""
