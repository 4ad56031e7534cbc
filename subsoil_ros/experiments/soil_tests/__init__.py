"""Virtual soil tests of a soil of particles: strength and stiffness of a cell, and the slope of a heap."""
