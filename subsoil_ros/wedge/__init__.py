"""Wedge model of the soil: failure wedges in front of tools and sinkage under wheels, in closed form."""

from ..kernel_cache import set_up_numba

set_up_numba()
