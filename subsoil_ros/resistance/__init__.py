"""Reduced soil: failure wedges in front of tools and sinkage under wheels, in closed form. No particles."""

from ..kernel_cache import use_kernel_cache

use_kernel_cache()
