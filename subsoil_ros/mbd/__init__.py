"""Mechanism engine: any planar machine of scene/mechanism.py, advanced tick by tick."""

from ..kernel_cache import use_kernel_cache

use_kernel_cache()
