"""How the inner kernels of the soil are compiled: cached on disk, IEEE division.

Only other kernels may call them: a call from Python ends the process. Without the wrappers for Python and C
they compile a sixth faster.
"""

from functools import partial

from numba import njit

inner_kernel = partial(
    njit, cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
)
"""Decorator of inner kernels, called with further options of njit."""
