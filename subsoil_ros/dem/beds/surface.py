"""The top surface of a bed over a lattice of columns, and how a bed is cut to a depth."""

import numpy as np

from ..bed import Bed


def top_surface_m(bed: Bed, radius_m: float) -> np.ndarray:
    """(nx, ny) [m] top of the bed in columns, as a sphere of the particles' size feels it from above.

    Lowered onto the bed in the middle of a column, the lowest point of the sphere comes to rest at this
    height; a ray would fall through the aligned gaps of a grid. The floor where there is no particle.
    Columns stand one radius apart, or a little more, so that they fill the box.
    """
    low = np.array(bed.lower_m[:2])
    size = np.array(bed.upper_m) - low
    count = np.maximum(1, np.floor(size / radius_m).astype(np.int64))
    pitch = size / count
    top = np.full(count, bed.lower_m[2])
    nearest = np.floor((bed.positions_m[:, :2] - low) / pitch).astype(np.int64)
    for dx in range(-2, 3):
        for dy in range(-2, 3):
            node = nearest + np.array((dx, dy))
            offset = low + (node + 0.5) * pitch - bed.positions_m[:, :2]
            below = 4.0 * radius_m**2 - (offset**2).sum(axis=1)
            hit = ((node >= 0) & (node < count)).all(axis=1) & (below >= 0.0)
            height = bed.positions_m[hit, 2] + np.sqrt(below[hit]) - radius_m
            np.maximum.at(top, (node[hit, 0], node[hit, 1]), height)
    return top


def cut_to_depth(bed: Bed, radius_m: float, depth_m: float) -> Bed:
    """The bed without the particles that reach above a level, such that its mean top is `depth_m` high.

    A bed that is not as high stays as it is. The order of the particles stays.
    """

    def below(level_m: float) -> Bed:
        kept = bed.positions_m[:, 2] + radius_m <= level_m
        return Bed(bed.positions_m[kept], bed.lower_m, bed.upper_m)

    low, high = bed.lower_m[2], float(bed.positions_m[:, 2].max()) + radius_m
    wanted = bed.lower_m[2] + depth_m
    if top_surface_m(bed, radius_m).mean() <= wanted:
        return bed
    while high - low > 1e-3 * radius_m:
        level = 0.5 * (low + high)
        if top_surface_m(below(level), radius_m).mean() > wanted:
            high = level
        else:
            low = level
    return below(low)
