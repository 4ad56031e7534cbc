"""How kernels of the mechanism are compiled: cached on disk, IEEE division, no fast-math."""

from numba import njit

kernel = njit(cache=True, error_model="numpy")

inner_kernel = njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""A kernel that only other kernels call: without the wrapper for Python it compiles much faster."""
