"""Tiled bed: a periodic sample replicated over the bin of a scene and brought to rest.

1. The sample is brought to rest under the law of the scene, adhesion and all, at the pressure half way down.
2. The sample is repeated over the bin and cut at the walls; the soil then settles into the gaps at the walls.
   Particles with centres up to one largest diameter below the bin's depth are fixed: a rough floor, with no
   plane along which particles could order.
3. Cut at its surface, it comes to rest in its weight, with the friction of the scene, under global damping.

Only positions are kept: the tangential springs of the contacts are zero when a run starts.
"""

import dataclasses
import itertools
import math

import numpy as np

from ...errors import SceneError
from ...limits.stable_steps import SAFETY, step_limits
from ...loading.loader import ResolvedScene
from ...scene.bed_kinds import TiledBed
from ...scene.pair_laws import layer_soils
from ...scene.soil import Soil
from ..bed import Bed, OnProgress, radii_of
from ..mixture import material_at
from ..periodic import HELD_LAYER
from .bed_file import load_bed, sample_path, store_bed
from .bed_geometry import cut_to_depth, mean_above_profile_m, sample_edge_m
from .bed_report import masses_kg
from .periodic_sample import at_pressure, endless_soil, pressed_sample, sample_soil, solid_fraction
from .relaxation import SETTLING_GRAVITY, Rest, Settling, of_the_preparation, relaxed_rest

RESTS = 3
"""Times that the bed comes to rest once it is cut, each time from places alone: when a run then starts
without springs, its particles move by 0.2 % of their radius, a third of what they do after one. One that
then moves too fast (MOVING), as when a loose particle falls, rests up to as many times again."""

FILLING_FALL, RELAXING_S = 10.0, 0.6
"""Fall in radii, besides three times the sinking of the top, that sets the longest time for the gaps at walls
to fill; longest time of each rest [s], of a field up to PATIENCE times more: dry soil comes to rest in it,
sticky soil long before."""

MOVING = 10.0
"""A bed that moves so many times as fast as one at rest, 10 % of a radius in a second, is refused."""

LARGEST_CHANGE = 0.02
"""Part of the solid fraction by which the law of a scene may change it: the density is met to as much."""


def prepare_tiled(resolved: ResolvedScene, threads: int, on_progress: OnProgress) -> Bed:
    """Tiled bed that fills the bin of the scene; z = 0 at its mean top.

    Raises:
        SceneError: the sample does not fit the bin, or changes its solid fraction under the scene's law or
            that of a layer; the bed does not come to rest.
    """
    soil, gravity = resolved.scene.particle_soil, resolved.scene.gravity_m_per_s2
    assert soil is not None

    def settling(of: Soil) -> Settling:
        return settling_under(resolved, threads, of, gravity, on_progress)

    bed = replicated(sample_under_law(resolved, sample_edge_m(soil), threads, on_progress), soil)
    last = settling(soil.model_copy(update=of_the_preparation(soil)))
    radius = soil.particles.mean_volume_radius_m
    speed = relaxed_rest(radius, last.contact_rate_per_s).speed_m_per_s
    damping = damping_per_s(soil, gravity)
    falls_m = FILLING_FALL * radius + 3.0 * _sinking_m(soil)
    loose = settling(soil.model_copy(update=of_the_preparation(soil) | {"layers": None}))
    bed = loose.run(bed, Rest(speed, falls_m / (damping * radius)), damping, "filling")
    bed = loose.run(bed, Rest(speed, RELAXING_S), damping, "relaxing")
    bed = _top_at_zero(cut_to_depth(bed, radius, soil.bin.depth_m + _below_depth_m(soil), soil.surface), soil)
    if soil.layers is not None:
        bed = dataclasses.replace(bed, materials=material_at(soil, -bed.positions_m[:, 2]))
    for count in range(1, 2 * RESTS + 1):
        bed = last.run(bed, Rest(speed, RELAXING_S), damping, "relaxing")
        if count >= RESTS and _rms_m_per_s(bed, soil) <= MOVING * speed:
            break
    bed = _top_at_zero(bed, soil)
    refuse_unfinished(bed, soil, speed)
    return bed


def settling_under(
    resolved: ResolvedScene, threads: int, soil: Soil, gravity_m_per_s2: float,
    on_progress: OnProgress,
) -> Settling:  # fmt: skip
    """Particles under the law of this soil, at its own step."""
    return Settling(
        resolved, threads, soil=soil, step_s=SAFETY * step_limits(soil)[0].limit_s,
        gravity_m_per_s2=gravity_m_per_s2, on_progress=on_progress,
    )  # fmt: skip


def damping_per_s(soil: Soil, gravity_m_per_s2: float) -> float:
    """Global damping on the way to rest: a fall by a radius takes not much longer than a free one."""
    return math.sqrt((gravity_m_per_s2 or SETTLING_GRAVITY) / soil.particles.mean_volume_radius_m)


def sample_under_law(resolved: ResolvedScene, edge_m: float, threads: int, on_progress: OnProgress) -> Bed:
    """The sample of about this edge [m] at rest under the law of a scene, at the pressure half way down.

    Raises:
        SceneError: this law, or that of a layer, changes its solid fraction.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None
    sample = cached_sample(resolved, edge_m, on_progress)
    layers = dict.fromkeys((soil.model_copy(update={"layers": None}), *layer_soils(soil)))
    found = [_sample_under(resolved, layer, edge_m, sample, threads, on_progress) for layer in layers]
    return found[0]


def _sample_under(
    resolved: ResolvedScene,
    soil: Soil,
    edge_m: float,
    sample: Bed,
    threads: int,
    on_progress: OnProgress,
) -> Bed:
    """The sample at rest under the law of a soil, at the pressure half way down."""
    whole = resolved.scene.particle_soil
    assert whole is not None
    assert isinstance(whole.bed, TiledBed)
    bulk = whole.bed.solid_fraction * whole.particles.density_kg_per_m3
    gravity = resolved.scene.gravity_m_per_s2 or SETTLING_GRAVITY
    pressure = 0.5 * bulk * gravity * whole.bin.depth_m
    settling = settling_under(resolved, threads, endless_soil(soil, edge_m), 0.0, on_progress)
    found = at_pressure(settling, sample, pressure, on_progress)
    _refuse_other_fraction(solid_fraction(found, soil), soil)
    return found


def cached_sample(resolved: ResolvedScene, edge_m: float, on_progress: OnProgress) -> Bed:
    """The pressed sample of about this edge [m] for a scene's tiled bed, from the cache if it is there."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    path, as_kept = sample_path(soil, edge_m), sample_soil(soil, edge_m)
    sample = load_bed(path, as_kept)
    if sample is None:
        sample = pressed_sample(resolved, edge_m, on_progress).bed
        store_bed(path, sample, as_kept)
    return sample


def _top_at_zero(bed: Bed, soil: Soil) -> Bed:
    top = mean_above_profile_m(bed, soil.particles.mean_volume_radius_m, soil.surface)
    lower = (bed.lower_m[0], bed.lower_m[1], bed.lower_m[2] - top)
    return dataclasses.replace(bed, positions_m=bed.positions_m - (0.0, 0.0, top), lower_m=lower)


def _rms_m_per_s(bed: Bed, soil: Soil) -> float:
    return math.sqrt(2.0 * bed.kinetic_energy_joule / float(masses_kg(bed, soil).sum()))


def with_patience(rest: Rest, bed: Bed, soil: Soil) -> Rest:
    """The rest of a bed, repeated while it moves faster than refuse_unfinished allows."""
    moving_m_per_s = MOVING * rest.speed_m_per_s
    return rest._replace(moving_joule=0.5 * float(masses_kg(bed, soil).sum()) * moving_m_per_s**2)


def refuse_unfinished(bed: Bed, soil: Soil, rest_m_per_s: float) -> None:
    """Raise SceneError for a bed that sank after it was cut, or moves MOVING times as fast as at rest."""
    speed_m_per_s = MOVING * rest_m_per_s
    short = soil.bin.depth_m + bed.floor_m
    found = _rms_m_per_s(bed, soil)
    if abs(short) > 2.0 * soil.particles.bounds_m[1] or found > speed_m_per_s:
        raise SceneError(
            f"soil.bed: did not come to rest: it is {-bed.floor_m:.3g} m deep and moves at {found:.2g} m/s "
            f"(rms); it must be {soil.bin.depth_m:g} m (soil.bin.depth_m) and {speed_m_per_s:.2g} m/s; make "
            "the bin wider or its sides periodic, or use a denser soil.bed.solid_fraction"
        )


def _refuse_other_fraction(found: float, soil: Soil) -> None:
    assert isinstance(soil.bed, TiledBed)
    wanted = soil.bed.solid_fraction
    if abs(found / wanted - 1.0) > LARGEST_CHANGE:
        raise SceneError(
            f"soil.bed.solid_fraction: {wanted:g} given; under soil.law the bed rests at {found:.3f}, "
            f"allowed is a change by {LARGEST_CHANGE:.0%}: adhesion and weight press its contacts too far "
            "together; use stiffer ones, or bed.kind 'dense_random'"
        )


def _below_depth_m(soil: Soil) -> float:
    """Distance from the depth of the bed to the plane below it."""
    assert isinstance(soil.bed, TiledBed)
    return (HELD_LAYER + 1.0) * soil.particles.bounds_m[1] if soil.bed.floor == "held" else 0.0


def _sinking_m(soil: Soil) -> float:
    """How far the top sinks while gaps at walls fill, each half a radius wide [m]."""
    box, largest = soil.bin, soil.particles.bounds_m[1]
    across = 0.0 if box.sides == "periodic" else 1.0 / box.width_m
    return box.depth_m * largest * (1.0 / box.length_m + across)


def _above_m(soil: Soil) -> float:
    """How far tiles reach above z = 0 [m]."""
    return 2.0 * soil.particles.bounds_m[1] + _sinking_m(soil)


def replicated(sample: Bed, soil: Soil) -> Bed:
    """The sample repeated over the bin, from the plane below to some particles above z = 0, cut at the walls;
    held below the depth.

    Periodic sides are a whole number of tiles apart.
    """
    assert isinstance(soil.bed, TiledBed)
    edge, radii = sample.periods_m[0], radii_of(sample, soil)
    tiles, periodic = round(soil.bin.width_m / edge), soil.bin.sides == "periodic"
    width = edge * tiles if periodic else soil.bin.width_m
    above = _above_m(soil)
    corner = np.array((0.0, -0.5 * width, above))
    size = np.array((soil.bin.length_m, width, above + soil.bin.depth_m + _below_depth_m(soil)))
    copies = [np.arange(math.ceil(along / edge)) for along in size]
    if periodic:
        copies[1] = np.arange(tiles)  # one more would come to lie on the first
    inside = sample.positions_m - np.array(sample.lower_m) - (0.0, 0.0, edge)  # z from -edge to 0
    shift = np.array([(i, j, -k) for i, j, k in itertools.product(*copies)]) * edge + corner
    places = (inside[None] + shift[:, None]).reshape(-1, 3)
    radius, length = np.tile(radii, len(shift)), soil.bin.length_m
    floor = -soil.bin.depth_m - _below_depth_m(soil)
    kept = (places[:, 0] >= radius) & (places[:, 0] <= length - radius) & (places[:, 2] >= floor + radius)
    if not periodic:
        kept &= np.abs(places[:, 1]) <= 0.5 * width - radius
    return dataclasses.replace(
        sample,
        positions_m=places,
        radii_m=None if soil.particles.sizes is None else radius,
        lower_m=(0.0, -0.5 * width, floor),
        upper_m=(length, 0.5 * width),
        sides=soil.bin.bed_sides,
        held=places[:, 2] < -soil.bin.depth_m if soil.bed.floor == "held" else None,
        kinetic_energy_joule=0.0,
    ).only(kept)
