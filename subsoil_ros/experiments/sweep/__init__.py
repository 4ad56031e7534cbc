"""Parameter sweeps on a Dask cluster, each scene run once."""
