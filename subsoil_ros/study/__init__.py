"""Many runs of one scene: sweeps, and what accuracy costs. Dask runs them, the kept runs hold them."""
