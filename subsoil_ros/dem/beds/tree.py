"""Neighbours of the particles of a bed by a k-d tree, also across the borders of a period."""

from typing import TYPE_CHECKING

import numpy as np

from ..bed import Bed
from ..periodic import wrapped

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


def bed_tree(bed: Bed) -> "cKDTree":
    """Tree of the bed's particles; query it for points `seen_from_corner`."""
    from scipy.spatial import cKDTree  # slow to import; a bed from the cache needs no tree

    periods = np.array(bed.periods_m)
    boxsize = np.where(np.isfinite(periods), periods, 0.0)
    return cKDTree(seen_from_corner(bed, bed.positions_m), boxsize=boxsize)


def seen_from_corner(bed: Bed, points_m: np.ndarray) -> np.ndarray:
    """`points_m` (n, 3) from the lower corner of the box, within one period of it."""
    seen = points_m - np.array(bed.lower_m)
    for a, period in enumerate(bed.periods_m):
        if np.isfinite(period):
            seen[:, a] = wrapped(seen[:, a], 0.0, period)[0]
    return seen
