"""The soil engine on a GPU: laws, contacts and integration of dem, compiled a second time by numba-cuda."""
