"""Numbers that belong to each particle, or to all of them alike, in kernels that serve both."""

import numpy as np
from numba import njit, types
from numba.extending import overload

PARTS = 64
"""Parts of the particles that threads take one by one; their sums are added in order, so that no sum
depends on the number of threads (chosen: enough to share them evenly)."""


def of_particle(value, i):
    """Number i of an array; a number for all stands for itself. Told apart when a kernel is compiled."""
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
