"""Defaults of `subsoil soil-test`; in a module of their own, so that its help imports nothing else."""

INERTIAL_NUMBER = 3e-3
"""Inertial number of shear: rate x diameter x sqrt(density / stress). By mu(I) of P. Jop et al., Nature
441 (2006) 727-730, it raises the friction coefficient by 0.003; reproduction/yuan_yu_2020/soil_tests.md has a
measured check."""

SHEAR_DIAMETERS = (12.0, 8.0, 8.0)
"""Length, width and height of the specimen in largest diameters, default and least: they leave a core of
9 x 5 x 5, and a travel of 4."""

NORMAL_TOLERANCE = 0.02
"""Tolerance of the normal stress, relative to the nominal one."""

LEAST_POINTS = 3
"""Least number of normal stresses for a fit of c and phi: a line through two points has no standard error."""
