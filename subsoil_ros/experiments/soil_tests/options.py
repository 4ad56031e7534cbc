"""What `subsoil soil-test` is told without options; apart, so that its help imports nothing else."""

INERTIAL_NUMBER = 3e-3
"""Of the shear: rate x diameter x sqrt(density / stress). By mu(I) of P. Jop et al., Nature
441 (2006) 727-730, it raises the friction coefficient by 0.003; docs/soil_tests.md has a measured check."""

LEAST_POINTS = 3
"""Normal stresses for a fit of c and phi: a line through two points has no error to show."""
