"""Soil steps in LAMMPS, on one rank of MPI or many; the tools and their contacts are the package's own."""
