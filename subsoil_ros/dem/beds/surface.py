"""The top surface of a bed over a lattice of columns, and how a bed is cut to a depth."""

import math

import numpy as np

from ...scene.bed_kinds import SurfaceProfile
from ..bed import Bed, profile_m


def top_surface_m(bed: Bed, radius_m: float) -> np.ndarray:
    """(nx, ny) [m] top of the bed in columns, as a sphere of the particles' size feels it from above.

    `radius_m` is that size, a mean one where the bed has radii of its own. Lowered onto the bed in the middle
    of a column, the lowest point of the sphere comes to rest at this height; a ray would fall through the
    aligned gaps of a grid. The floor where there is no particle. Columns stand one radius apart, or a little
    more, so that they fill the box.
    """
    low = np.array(bed.lower_m[:2])
    size = np.array(bed.upper_m) - low
    count = np.maximum(1, np.floor(size / radius_m).astype(np.int64))
    pitch = size / count
    top = np.full(count, bed.lower_m[2])
    nearest = np.floor((bed.positions_m[:, :2] - low) / pitch).astype(np.int64)
    if bed.radii_m is None:
        touch2, columns = np.full(len(bed.positions_m), 4.0 * radius_m**2), 2
    else:
        touch2 = (bed.radii_m + radius_m) ** 2
        columns = math.ceil((float(bed.radii_m.max()) + radius_m) / float(pitch.min()))
    for dx in range(-columns, columns + 1):
        for dy in range(-columns, columns + 1):
            node = nearest + np.array((dx, dy))
            offset = low + (node + 0.5) * pitch - bed.positions_m[:, :2]
            if bed.sides != "walls":
                node[:, 1] %= count[1]
            if bed.sides == "endless":
                node[:, 0] %= count[0]
            below = touch2 - (offset**2).sum(axis=1)
            hit = ((node >= 0) & (node < count)).all(axis=1) & (below >= 0.0)
            height = bed.positions_m[hit, 2] + np.sqrt(below[hit]) - radius_m
            np.maximum.at(top, (node[hit, 0], node[hit, 1]), height)
    return top


def mean_above_profile_m(bed: Bed, radius_m: float, surface: SurfaceProfile | None) -> float:
    """Mean of the bed's top over the profile's height, z as the bed has it [m]."""
    top = top_surface_m(bed, radius_m)
    columns = (np.arange(top.shape[0]) + 0.5) / top.shape[0]
    x = bed.lower_m[0] + columns * (bed.upper_m[0] - bed.lower_m[0])
    return float((top - profile_m(surface, x)[:, None]).mean())


def trimmed(bed: Bed, radius_m: float, surface: SurfaceProfile | None, level_m: float = 0.0) -> Bed:
    """The bed without the particles that reach above `level_m` + profile. Their order stays."""
    ceiling = level_m + profile_m(surface, bed.positions_m[:, 0]) + 1e-9 * radius_m
    return bed.only(bed.positions_m[:, 2] + _radii(bed, radius_m) <= ceiling)


def _radii(bed: Bed, radius_m: float) -> float | np.ndarray:
    """Radius of every particle; `radius_m` where all are equal."""
    return radius_m if bed.radii_m is None else bed.radii_m


def cut_to_depth(bed: Bed, radius_m: float, depth_m: float, surface: SurfaceProfile | None = None) -> Bed:
    """The bed trimmed at the level where its mean top stands `depth_m` + profile over its floor.

    A bed that is not as high stays as it is.
    """

    def height_of(cut: Bed) -> float:
        return mean_above_profile_m(cut, radius_m, surface)

    low = bed.lower_m[2]
    tallest = float((bed.positions_m[:, 2] + _radii(bed, radius_m)).max())
    high = tallest - float(profile_m(surface, bed.positions_m[:, 0]).min())
    wanted = bed.lower_m[2] + depth_m
    if height_of(bed) <= wanted:
        return bed
    while high - low > 1e-3 * radius_m:
        level = 0.5 * (low + high)
        if height_of(trimmed(bed, radius_m, surface, level)) > wanted:
            high = level
        else:
            low = level
    return trimmed(bed, radius_m, surface, low)
