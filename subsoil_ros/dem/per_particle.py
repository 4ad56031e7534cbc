"""Numbers of each particle, or one number for all, in kernels that take both."""

import numpy as np
from numba import njit, types
from numba.extending import overload

PARTS = 64
"""Parts into which particles are split for threads: enough to share them evenly. The sums of parts are added
in order, so that no sum depends on the number of threads."""


def of_particle(value, i):
    """Element i of an array, or `value` itself if it is one number for all; decided at compile time."""
    return value[i] if np.ndim(value) > 0 else value


@overload(of_particle)
def _of_particle(value, i):
    if isinstance(value, types.Array):
        return lambda value, i: value[i]
    return lambda value, i: value


@njit(cache=True, nogil=True)
def added_up(parts):
    """Sum of an array (n,) in its order; `parts.sum()` in a parallel kernel is shared among threads."""
    total = 0.0
    for number in parts:
        total += number
    return total
