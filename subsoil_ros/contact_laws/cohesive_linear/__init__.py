"""Linear springs with a linear cohesion that acts across a gap too."""
