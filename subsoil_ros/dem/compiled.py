"""How the inner kernels of the soil are compiled: cached on disk, IEEE division.

Only other kernels call them. Without the wrappers for Python and C they compile a sixth faster; called from
Python one ends the process.
"""

from functools import partial

from numba import njit

inner_kernel = partial(
    njit, cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
)
"""Decorator, called with the options that a kernel has besides."""
