"""Mechanism engine: any planar machine of scene/mechanism.py, advanced tick by tick."""

from ..kernel_cache import set_up_numba

set_up_numba()
