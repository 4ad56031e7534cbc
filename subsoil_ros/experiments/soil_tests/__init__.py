"""Virtual direct shear and tension tests of a soil of particles."""
