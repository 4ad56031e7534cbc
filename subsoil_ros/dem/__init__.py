"""Discrete-element soil."""

import os

from ..kernel_cache import use_kernel_cache

# OpenMP threads would spin between parallel regions and take the cores of the other nodes. OpenMP reads
# this once, when numba first uses it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
use_kernel_cache()
