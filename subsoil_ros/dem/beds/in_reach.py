"""Pairs of particles of a bed in reach of each other, for any sizes and layers."""

from typing import NamedTuple

import numpy as np

from ...scene.pair_laws import layer_soils, particle_values
from ...scene.soil import Soil
from ..bed import Bed, radii_of
from ..periodic import wrapped
from .tree import bed_tree


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
