"""The soil engine on a GPU: laws, contacts and integration of dem, compiled a second time by numba-cuda."""

import contextlib

from ...kernel_cache import KernelLocator

with contextlib.suppress(ImportError):  # numba's simulator compiles nothing
    from numba.cuda.core.caching import CacheImpl

    CacheImpl._locator_classes.insert(0, KernelLocator)
