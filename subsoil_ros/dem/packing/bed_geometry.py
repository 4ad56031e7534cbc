"""Geometry of a bed: edge of its periodic sample, top surface, depth, and pairs of particles in reach."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...errors import SceneError
from ...scene.bed_kinds import SurfaceProfile, TiledBed
from ...scene.pair_laws import layer_soils, pair_values, particle_values
from ...scene.soil import Soil
from ..bed import Bed, profile_m, radii_of
from ..periodic import SMALLEST_CELLS, up_to_mm, wrapped

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

LARGEST_OVERLAP = 0.5
"""A start whose particles overlap by more than this part of the smaller radius beyond rest is refused: such a
pair would fly apart at several m/s under the paper's law."""

USUAL_EDGE = 40.0
"""Edge of a sample over the mean radius if the scene gives none: some 9,000 particles. Small ones scatter."""

MARGIN = 1.05
"""Margin of the smallest edge: a sample shrinks while it is pressed and under the law of a scene."""

SKIN = 0.3
"""Skin of the neighbour lists over the radius while settling; that of the scene may differ from run to run,
and the bed must not."""


def sample_edge_m(soil: Soil) -> float:
    """Edge of the cubic sample of a scene's bed [m]; periodic sides take a whole number of samples.

    Raises:
        SceneError: it is larger than the bin, or its particles would not have one nearest image.
    """
    assert isinstance(soil.bed, TiledBed)
    length, width = soil.bin.length_m, soil.bin.width_m
    reach = max(pair_values(layer)[0].reach for layer in layer_soils(soil))
    radius = soil.particles.mean_volume_radius_m
    smallest = MARGIN * SMALLEST_CELLS * (2.0 * soil.particles.bounds_m[1] + reach + SKIN * radius)
    given, largest = soil.bed.tile_m, min(length, width)
    if given is not None and not smallest <= given <= largest:
        raise SceneError(
            f"soil.bed.tile_m: {given:g} m given; allowed is at least {up_to_mm(smallest):g} m, "
            f"{SMALLEST_CELLS} times the reach of a particle, and at most {largest:g} m, the smaller of "
            "soil.bin.length_m and soil.bin.width_m"
        )
    if largest < smallest:
        raise SceneError(
            f"soil.bin: {length:g} x {width:g} m is narrower than the smallest tile, "
            f"{up_to_mm(smallest):g} m, {SMALLEST_CELLS} times the reach of a particle; make the bin wider "
            "or the particles smaller"
        )
    edge = given or max(smallest, min(USUAL_EDGE * radius, largest))
    if soil.bin.sides != "periodic":
        return edge
    tiles = round(width / edge)
    return width / (tiles if width / tiles >= smallest else tiles - 1)


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


class InReach(NamedTuple):
    """Pairs of particles in reach."""

    pair: np.ndarray  # (p, 2) int64, numbers of the particles
    excess_m: np.ndarray  # (p,) overlap beyond rest; negative: stretched
    smaller_m: np.ndarray  # (p,) the smaller of the two radii


def pairs_in_reach(bed: Bed, soil: Soil) -> InReach:
    """All pairs in reach of each other."""
    layers = layer_soils(soil)
    values = [particle_values(one, other, 1.0, 1.0) for one in layers for other in layers]
    reach, rest = np.array([(found.reach, found.rest_overlap) for found in values]).T
    radius, x = radii_of(bed, soil), bed.positions_m
    material = np.zeros(len(x), np.int64) if bed.materials is None else bed.materials
    farthest = 2.0 * float(radius.max()) + float(reach.max())
    pair = bed_tree(bed).query_pairs(farthest, output_type="ndarray").astype(np.int64)
    first, second = pair.T
    kind = material[first] * len(layers) + material[second]
    touch = radius[first] + radius[second]
    apart = x[first] - x[second]
    for a, period in enumerate(bed.periods_m):
        if np.isfinite(period):
            apart[:, a] = wrapped(apart[:, a], -0.5 * period, period)[0]
    distance = np.linalg.norm(apart, axis=1)
    near = distance <= touch + reach[kind]
    excess = touch - rest[kind] - distance
    return InReach(pair[near], excess[near], np.minimum(radius[first], radius[second])[near])
