"""Dense random bed: random close packing of smooth spheres, then bonded and relaxed (SOIL_FINDINGS.md).

1. Random points, overlaps pushed apart under strong damping.
2. Settled under gravity without friction and adhesion, to random close packing.
3. Adhesion on. Neighbours that do not touch now pull, and a bed between fixed walls would tear off them:
   bed and walls are scaled together to the size of least energy.
4. Cut to its depth, and relaxed under global damping, size and walls following, until it is at rest.

No step has friction, so no tangential spring is wound up: normal forces alone hold the bed, its positions
are its whole state, and it stands as well with the friction of the run.
"""

import dataclasses
import math

import numpy as np
from scipy.optimize import minimize_scalar

from ...scene.bed_spacing import rest_spacing_m
from ...scene.beds import SurfaceProfile
from ...scene.loader import ResolvedScene
from ...scene.pairs import pair_values, particle_mass_kg
from ...scene.soil import Bin, Soil
from ..bed import Bed, grid_shape
from .settling import EngineOf, Rest, Settling, Watch
from .surface import cut_to_depth, mean_above_profile_m

CLOSE_PACKING = 0.64
"""Solid fraction of random close packing, spheres of the rest distance 2 r - delta_c. Walls loosen it, so
a box filled for this value is filled too high, never too low."""

POURED = 0.55
"""Solid fraction of the random points before they settle (chosen: it falls by a seventh of its height)."""

SETTLING_GRAVITY = 9.81
"""[m/s2] while settling, also where the scene has none."""

PILOT_DIAMETERS = 12.0
"""Edge of the small bed that tells how far a bonded bed shrinks, in rest distances."""

SCALE_TOLERANCE = 2e-4
"""The size of the bed is found when it changes by less: 0.1 mm in 0.5 m."""

SCALE_BOUNDS = (0.8, 1.05)
"""The least energy is sought between these scales (0.98 for the paper's law)."""

QUENCH_S, QUENCH_DAMPING = 0.05, 10.0
"""How long overlaps are pushed apart, and the global damping meanwhile, over sqrt(K / m) (chosen)."""

FALL_DAMPING = 4.0
"""Global damping while settling, over sqrt(g / depth): the bed falls at about a quarter of the speed of a
free fall through its depth (chosen)."""

RELAX_DAMPING = 0.25
"""Global damping while relaxing, over sqrt(K / m): near critical for waves some particles long (chosen)."""

RESIZE_S, LARGEST_RESIZES = 0.03, 8
"""Relaxation between two changes of size, and their largest number (chosen)."""


def settled_rest(radius_m: float) -> Rest:
    """After settling: 5 % of the speed of a fall by one diameter; then only rattlers move (chosen)."""
    return Rest(0.05 * math.sqrt(4.0 * SETTLING_GRAVITY * radius_m), 1.5)


def relaxed_rest(radius_m: float) -> Rest:
    """After relaxation: 1 % of the radius in a second (chosen)."""
    return Rest(0.01 * radius_m, 2.0)


def prepare_dense(resolved: ResolvedScene, seed: int, engine_of: EngineOf, threads: int, watch: Watch) -> Bed:
    """Dense random bed that fills the bin of the scene; z = 0 at its mean top."""
    soil = resolved.scene.soil
    assert soil is not None
    grid_shape(soil)  # refuses a bin too small for a particle
    gravity = resolved.scene.gravity_m_per_s2
    loose = Settling(
        resolved, engine_of, threads, adhesive=False, gravity_m_per_s2=SETTLING_GRAVITY, watch=watch
    )
    bonded = Settling(resolved, engine_of, threads, adhesive=True, gravity_m_per_s2=gravity, watch=watch)
    edge = PILOT_DIAMETERS * rest_spacing_m(soil)
    pilot = _settled(soil, Bin(length_m=edge, width_m=edge, depth_m=edge), seed, loose)
    shrink = _bonded(pilot, edge, soil, bonded).upper_m[0] / edge

    box = soil.bin
    larger = Bin(length_m=box.length_m / shrink, width_m=box.width_m / shrink, depth_m=box.depth_m / shrink)
    return _bonded(_settled(soil, larger, seed, loose), box.depth_m, soil, bonded, soil.surface)


def _settled(soil: Soil, box: Bin, seed: int, loose: Settling) -> Bed:
    """Random close packing in `box`, floor at z = 0, a little higher than the box is deep."""
    radius, rest = soil.particles.radius_m, rest_spacing_m(soil)
    wall = radius - pair_values(soil)[1].rest_overlap
    sphere = math.pi / 6.0 * rest**3
    area = box.length_m * box.width_m
    stiffness, mass = pair_values(soil)[0].stiffness, particle_mass_kg(soil)
    count = math.ceil(CLOSE_PACKING * area * (box.depth_m + rest) / sphere)
    half_width = 0.5 * box.width_m
    low = (wall, wall - half_width, wall)
    high = (box.length_m - wall, half_width - wall, count * sphere / (POURED * area))
    points = np.random.default_rng(seed).uniform(low, high, (count, 3))
    bed = Bed(points, (0.0, -half_width, 0.0), (box.length_m, half_width))
    # Far above the critical damping of a pair, so that no particle flies out of the top.
    bed = loose.run(bed, Rest(0.0, QUENCH_S), QUENCH_DAMPING * math.sqrt(stiffness / mass), "parting")
    damping = FALL_DAMPING * math.sqrt(SETTLING_GRAVITY / box.depth_m)
    return loose.run(bed, settled_rest(radius), damping, "settling")


def _bonded(
    bed: Bed, depth_m: float, soil: Soil, bonded: Settling, surface: SurfaceProfile | None = None
) -> Bed:
    """The settled bed cut to `depth_m`, with adhesion and at rest; z = 0 at its mean top over the profile."""
    radius = soil.particles.radius_m
    bed, _ = _least_energy(bed, bonded)
    bed = cut_to_depth(bed, radius, depth_m, surface)
    rest = relaxed_rest(radius)
    damping = RELAX_DAMPING * math.sqrt(pair_values(soil)[0].stiffness / particle_mass_kg(soil))
    for _ in range(LARGEST_RESIZES):
        bed = bonded.run(bed, Rest(rest.speed_m_per_s, RESIZE_S), damping, "fitting")
        bed, scale = _least_energy(bed, bonded)
        if abs(scale - 1.0) < SCALE_TOLERANCE:
            break
    bed = bonded.run(bed, rest, damping, "relaxing")
    top = mean_above_profile_m(bed, radius, surface)
    lower = (bed.lower_m[0], bed.lower_m[1], bed.lower_m[2] - top)
    return dataclasses.replace(bed, positions_m=bed.positions_m - (0.0, 0.0, top), lower_m=lower)


def _least_energy(bed: Bed, bonded: Settling) -> tuple[Bed, float]:
    """Bed and walls scaled about the origin to the size of least energy, and the scale."""
    found = minimize_scalar(
        lambda scale: bonded.potential_joule(scaled(bed, scale)),
        bounds=SCALE_BOUNDS,
        method="bounded",
        options={"xatol": 0.1 * SCALE_TOLERANCE},
    )
    return scaled(bed, float(found.x)), float(found.x)


def scaled(bed: Bed, scale: float) -> Bed:
    """Bed and walls `scale` times as large, about the origin."""
    x, y, z = bed.lower_m
    far, left = bed.upper_m
    return Bed(bed.positions_m * scale, (x * scale, y * scale, z * scale), (far * scale, left * scale))
