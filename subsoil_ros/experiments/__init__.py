"""What runs many simulations: sweeps, studies, calibrations, soil tests, and the runs they keep."""
