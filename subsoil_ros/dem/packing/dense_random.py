"""Dense random bed: random close packing of smooth spheres, then bonded and relaxed.

1. Random points, overlaps pushed apart under strong damping.
2. Settled under gravity without friction and adhesion, to random close packing.
3. Adhesion is added. Neighbours across a gap then attract each other, which would tear a bed off fixed walls:
   bed and walls are scaled together to the size of least energy.
4. Cut to its depth, and relaxed under global damping, size and walls following, until it is at rest, or for
   RELAX_PERIODS.

Sizes are drawn before step 1. Depth sets the layers after step 2, which has the common law and density; from
step 3 on every layer has its own. Layers whose bonds shrink them differently share one width,
so one of them may be left under tension: the report shows gaps.

No step has friction, so no tangential spring is loaded, and positions are the bed's whole state. In beds of
stiff particles, normal forces alone do not carry the whole weight; friction in the run carries the rest.
"""

import dataclasses
import math

import numpy as np

from ...loading.loader import ResolvedScene
from ...scene.bed_kinds import SurfaceProfile
from ...scene.pair_laws import pair_values, rest_spacing_m
from ...scene.sizes import sampled_radii_m
from ...scene.soil import Bin, Soil
from ..bed import Bed, OnProgress, scaled
from ..mixture import material_at
from .bed_geometry import cut_to_depth, mean_above_profile_m
from .grid import grid_shape
from .relaxation import (
    SETTLING_GRAVITY,
    Rest,
    Settling,
    relaxed_rest,
    settling_step_s,
    smooth_soil,
)  # fmt: skip
from .start import rest_volume_m3

CLOSE_PACKING = 0.64
"""Solid fraction of random close packing, spheres of the rest distance 2 r - delta_c. Walls loosen it, so
a box filled for this value is filled too high, never too low."""

UNEQUAL_PACKING = 0.74
"""The same for spheres of several sizes, up to LARGEST_RATIO: above what they pack to, as small ones fill the
gaps between large ones. Particles too many are cut off again."""

POURED = 0.55
"""Solid fraction of the random points before they settle: the bed then falls by a seventh of its height."""

PILOT_DIAMETERS = 12.0
"""Edge of the pilot bed, which shows how far a bonded bed shrinks, in rest distances."""

SCALE_TOLERANCE = 2e-4
"""The size of the bed is found when it changes by less: 0.1 mm in 0.5 m."""

SCALE_BOUNDS = (0.8, 1.05)
"""The least energy is sought between these scales (0.98 for the paper's law)."""

QUENCH_S, QUENCH_DAMPING = 0.05, 10.0
"""Time in which overlaps are pushed apart, and the global damping over sqrt(K / m): far above critical, so
that no particle flies out of the top. Overlaps that are left vanish while the bed settles."""

FALL_DAMPING = 4.0
"""Global damping while settling, over sqrt(g / depth): the bed falls at about a quarter of the speed of a
free fall through its depth."""

RELAX_DAMPING = 0.25
"""Global damping while relaxing, over sqrt(K / m): near critical for waves some particles long."""

RESIZE_S, LARGEST_RESIZES = 0.03, 8
"""Relaxation between two changes of size, and their largest number. A bed that does
not meet SCALE_TOLERANCE by then keeps its size."""


def settled_rest(radius_m: float) -> Rest:
    """Rest after settling: 5 % of the speed of a fall by one diameter; then only rattlers move."""
    return Rest(0.05 * math.sqrt(4.0 * SETTLING_GRAVITY * radius_m), 1.5)


def prepare_dense(
    resolved: ResolvedScene, seed: int, threads: int, on_progress: OnProgress, device: str = "cpu"
) -> Bed:
    """Dense random bed that fills the bin of the scene; z = 0 at its mean top.

    device: "cpu", or "gpu", on which it settles to another bed of the kind.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None
    grid_shape(soil)  # refuses a bin too small for a particle
    common = resolved.scene.model_copy(update={"soil": soil.model_copy(update={"layers": None})})
    gravity = resolved.scene.gravity_m_per_s2
    without_layers = common.particle_soil
    assert without_layers is not None
    smooth, sticky = smooth_soil(without_layers, adhesive=False), smooth_soil(soil, adhesive=True)
    smooth, sticky = (one.model_copy(update={"device": device}) for one in (smooth, sticky))
    loose = Settling(
        dataclasses.replace(resolved, scene=common), threads, soil=smooth,
        step_s=settling_step_s(smooth), gravity_m_per_s2=SETTLING_GRAVITY, on_progress=on_progress,
    )  # fmt: skip
    bonded = Settling(
        resolved, threads, soil=sticky, step_s=settling_step_s(sticky), gravity_m_per_s2=gravity,
        on_progress=on_progress,
    )  # fmt: skip
    edge = PILOT_DIAMETERS * rest_spacing_m(soil)
    pilot = _settled(soil, Bin(length_m=edge, width_m=edge, depth_m=edge, sides=soil.bin.sides), seed, loose)
    shrink = _bonded(pilot, edge, soil, bonded).upper_m[0] / edge

    box = soil.bin
    sizes = (box.length_m / shrink, box.width_m / shrink, box.depth_m / shrink)
    larger = Bin(length_m=sizes[0], width_m=sizes[1], depth_m=sizes[2], sides=box.sides)
    return _bonded(_settled(soil, larger, seed, loose), box.depth_m, soil, bonded, soil.surface)


def _settled(soil: Soil, box: Bin, seed: int, loose: Settling) -> Bed:
    """Random close packing in `box`, floor at z = 0, a little higher than the box is deep.

    Its layers are those of the soil, stretched to the depth of the box.
    """
    radius, rest, sizes = soil.particles.mean_volume_radius_m, rest_spacing_m(soil), soil.particles.sizes
    wall = soil.particles.bounds_m[1] - pair_values(soil)[1].rest_overlap
    sphere = rest_volume_m3(soil)
    packing = CLOSE_PACKING if sizes is None else UNEQUAL_PACKING
    area = box.length_m * box.width_m
    count = math.ceil(packing * area * (box.depth_m + rest) / sphere)
    half_width = 0.5 * box.width_m
    side = 0.0 if box.sides == "periodic" else wall
    low = (wall, side - half_width, wall)
    high = (box.length_m - wall, half_width - side, count * sphere / (POURED * area))
    points = np.random.default_rng(seed).uniform(low, high, (count, 3))
    radii = None if sizes is None else sampled_radii_m(sizes, count)
    sides = (0.0, -half_width, 0.0), (box.length_m, half_width)
    bed = Bed(points, *sides, sides=box.bed_sides, radii_m=radii)
    # Far above the critical damping of a pair, so that no particle flies out of the top.
    bed = loose.run(bed, Rest(0.0, QUENCH_S), QUENCH_DAMPING * loose.contact_rate_per_s, "parting")
    damping = FALL_DAMPING * math.sqrt(SETTLING_GRAVITY / box.depth_m)
    bed = loose.run(bed, settled_rest(radius), damping, "settling")
    if soil.layers is None:
        return bed
    depth = soil.bin.depth_m * (1.0 - bed.positions_m[:, 2] / box.depth_m)
    return dataclasses.replace(bed, materials=material_at(soil, depth))


def _bonded(
    bed: Bed, depth_m: float, soil: Soil, bonded: Settling, surface: SurfaceProfile | None = None
) -> Bed:
    """The settled bed cut to `depth_m`, with adhesion and at rest; z = 0 at its mean top over the profile."""
    radius = soil.particles.mean_volume_radius_m
    bed, _ = _least_energy(bed, bonded)
    bed = cut_to_depth(bed, radius, depth_m, surface)
    rest = relaxed_rest(radius, bonded.contact_rate_per_s)
    damping = RELAX_DAMPING * bonded.contact_rate_per_s
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
    from scipy.optimize import minimize_scalar  # slow to import; a bed from the cache does without

    found = minimize_scalar(
        lambda scale: bonded.potential_joule(scaled(bed, scale)),
        bounds=SCALE_BOUNDS,
        method="bounded",
        options={"xatol": 0.1 * SCALE_TOLERANCE},
    )
    return scaled(bed, float(found.x)), float(found.x)
