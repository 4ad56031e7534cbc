"""Graded beds: beds of several sizes put together about a core (scene.coarse).

1. Every size is prepared alone, at the solid fraction of the scene, in the same box.
2. Of each, the particles are taken whose centres lie where their size belongs. The solid fraction is then met
   on both sides of an interface, but particles of two beds overlap there.
3. These are parted without friction and weight, all that is far from an interface being held. Spheres without
   friction jam at a solid fraction of 0.64, so looser ones find places without overlap, in part above the
   surface. From there they sink back in their weight, with a friction that leaves them near the fraction.

It then comes to rest under the law of the scene, as other beds do (tiled, ground).
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from ...limits.stable_steps import SAFETY, step_limits
from ...loading.loader import ResolvedScene
from ...scene.beds import TiledBed
from ...scene.soil import Soil
from ..bed import Bed
from .dense import relaxed_rest
from .settling import SETTLING_GRAVITY, EngineOf, OnProgress, Rest, Settling
from .tile import FRICTIONLESS, JAMMED_AT, PARTING_DAMPING, PARTING_S, under_springs

PARTED_DIAMETERS = 2.0
"""Distance from an interface, in diameters of the largest particle, within which particles are parted: those
that overlap are within a half, and push two more ahead of them."""

SINKING_S = 0.3
"""Longest time to sink back: ten times that of a fall by a radius, 30 ms."""

SINKING_COMPACTS = 0.02
"""Wanted solid fraction less that of the friction while sinking, because sinking compacts (measured over four
slices about an interface: 0.599 in place of 0.600; with 0 it is 0.612, without sinking 0.588)."""

LATTICE = 400
"""Points along y and z by which the areas of the sizes are found: to 1/400 of the width."""


def of_grade(resolved: ResolvedScene, soil: Soil, edge_m: float) -> ResolvedScene:
    """The scene with the soil of one size, in tiles of this edge."""
    alone = soil.model_copy(update={"bed": soil.bed.model_copy(update={"tile_m": edge_m})})
    return dataclasses.replace(resolved, scene=resolved.scene.model_copy(update={"soil": alone}))


def grades_at(soil: Soil, y_m: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
    """(n,) int64: the size that belongs at each place, by number from the core outwards."""
    coarse = soil.particles.coarse
    assert coarse is not None
    ends = coarse.ends_m(soil.particles.grades[0].mean_volume_radius_m)
    return np.searchsorted(ends, coarse.distance_m(y_m, depth_m), side="right").astype(np.int64)


def grade_parts(soil: Soil, across_m: tuple[float, float], deep_m: tuple[float, float]) -> np.ndarray:
    """(sizes,) part of the section from y to y and depth to depth where each size belongs."""
    middles = (np.arange(LATTICE) + 0.5) / LATTICE
    (y, depth), (y_end, depth_end) = zip(across_m, deep_m, strict=True)
    places = np.meshgrid(y + (y_end - y) * middles, depth + (depth_end - depth) * middles)
    belongs = grades_at(soil, places[0].ravel(), places[1].ravel())
    return np.bincount(belongs, minlength=len(soil.particles.grades)) / LATTICE**2


def put_together(
    resolved: ResolvedScene,
    soil: Soil,
    beds: Sequence[Bed],
    top_m: float,
    engine_of: EngineOf,
    on_progress: OnProgress,
) -> Bed:
    """One bed from the beds of all sizes, which are in one box with their surface at `top_m`. Its particles
    are parted, but not at rest. `soil` is that of the box."""
    parts = []
    for k, bed in enumerate(beds):
        x = bed.positions_m
        parts.append(bed.only(grades_at(soil, x[:, 1], top_m - x[:, 2]) == k))
    counts = [len(part.positions_m) for part in parts]
    none_held = any(part.held is None for part in parts)
    whole = dataclasses.replace(
        parts[0],
        positions_m=np.concatenate([part.positions_m for part in parts]),
        radii_m=np.concatenate([part.radii_m for part in parts]),
        materials=np.repeat(np.arange(len(parts)), counts),
        held=None if none_held else np.concatenate([part.held for part in parts]),
    )
    return _parted(resolved, soil, whole, top_m, engine_of, on_progress)


def _parted(
    resolved: ResolvedScene, soil: Soil, bed: Bed, top_m: float, engine_of: EngineOf, on_progress: OnProgress
) -> Bed:
    coarse, x = soil.particles.coarse, bed.positions_m
    assert coarse is not None
    radius = soil.particles.mean_volume_radius_m
    from_core = coarse.distance_m(x[:, 1], top_m - x[:, 2])
    from_ends = np.abs(from_core[:, None] - coarse.ends_m(radius)).min(axis=1)
    far = from_ends > PARTED_DIAMETERS * 2.0 * soil.particles.bounds_m[1]

    def settling(friction: float, gravity_m_per_s2: float) -> Settling:
        springs = under_springs(soil, friction)
        return Settling(
            resolved, engine_of, 1, soil=springs, step_s=SAFETY * step_limits(springs)[0].limit_s,
            gravity_m_per_s2=gravity_m_per_s2, on_progress=on_progress,
        )  # fmt: skip

    parting = settling(FRICTIONLESS, 0.0)
    rate = parting.contact_rate_per_s
    apart = Rest(0.0, PARTING_S * 2.0 * math.pi / rate)
    some = parting.run(dataclasses.replace(bed, held=far), apart, PARTING_DAMPING * rate, "parting")
    some = dataclasses.replace(some, held=far if bed.held is None else far | bed.held)
    assert isinstance(soil.bed, TiledBed)
    looser = soil.bed.solid_fraction - SINKING_COMPACTS
    sinking = settling(float(np.interp(looser, *np.array(JAMMED_AT).T)), SETTLING_GRAVITY)
    rest = Rest(relaxed_rest(radius, rate).speed_m_per_s, SINKING_S)
    some = sinking.run(some, rest, math.sqrt(SETTLING_GRAVITY / radius), "sinking")
    return dataclasses.replace(some, held=bed.held)
