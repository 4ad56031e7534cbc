"""Linear springs and dashpots that act while spheres overlap."""
