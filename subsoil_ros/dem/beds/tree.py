"""Neighbours of the particles of a bed by a k-d tree, also across periodic sides."""

import numpy as np
from scipy.spatial import cKDTree

from ..bed import Bed
from ..periodic import wrapped


def bed_tree(bed: Bed) -> cKDTree:
    """Tree of the bed's particles; it is asked for points `seen_from_corner`."""
    return cKDTree(seen_from_corner(bed, bed.positions_m), boxsize=(0.0, bed.period_m or 0.0, 0.0))


def seen_from_corner(bed: Bed, points_m: np.ndarray) -> np.ndarray:
    """`points_m` (n, 3) from the lower corner of the box, within one period of it."""
    seen = points_m - np.array(bed.lower_m)
    if bed.period_m is not None:
        seen[:, 1] = wrapped(seen[:, 1], 0.0, bed.period_m)[0]
    return seen
