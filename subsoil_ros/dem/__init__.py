"""Discrete-element soil."""

from ..kernel_cache import set_up_numba

set_up_numba()
