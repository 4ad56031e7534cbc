"""The sample that a field repeats: soil at rest in its weight between periodic sides along x and y.

Periodic samples under the law of the scene, stacked as deep as the bed over held soil, come to rest in their
weight. Cut at the surface, they come to rest once more. With the springs that its contacts then have, that is
the sample of the field.
"""

import dataclasses
import math

import numpy as np

from ...loading.loader import ResolvedScene
from ...scene.soil import Bin, Soil
from ..bed import Bed, OnProgress, ignore_progress, radii_of
from ..contact import history_parity
from ..engine import SoilEngine
from ..field import HEADROOM, Contacts, FieldSample, headroom_m
from ..mixture import material_at
from ..periodic import HELD_LAYER
from .bed_file import bed_path, load_bed, load_contacts, store_bed
from .bed_geometry import cut_to_depth, mean_above_profile_m, sample_edge_m
from .relaxation import Rest, bed_of, of_the_preparation, relaxed_rest
from .replicate import (
    RELAXING_S,
    damping_per_s,
    refuse_unfinished,
    sample_under_law,
    settling_under,
    with_patience,
)  # fmt: skip


def cached_field_sample(
    resolved: ResolvedScene, threads: int = 1, on_progress: OnProgress = ignore_progress
) -> FieldSample:
    """The sample of a scene's field, from the cache if it is there.

    Raises:
        SceneError: the sample does not fit, has another solid fraction under the law, or comes to no rest.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None
    edge = sample_edge_m(soil)
    path, as_kept = bed_path(resolved), _endless(soil, edge)
    bed, contacts = load_bed(path, as_kept), load_contacts(path)
    if bed is not None and contacts is not None:
        return FieldSample(bed, Contacts(*contacts))
    sample = _prepared(resolved, edge, threads, on_progress)
    store_bed(path, sample.bed, as_kept, sample.contacts)
    return sample


def _endless(soil: Soil, edge_m: float) -> Soil:
    """The soil of a scene, layers and all, in a box that repeats itself, its surface below the top."""
    box = Bin(length_m=edge_m, width_m=edge_m, depth_m=soil.bin.depth_m + headroom_m(soil))
    box = box.model_copy(update={"sides": "endless"})
    return soil.model_copy(update={"bin": box, "window": None, "surface": None} | of_the_preparation(soil))


def _prepared(resolved: ResolvedScene, edge_m: float, threads: int, on_progress: OnProgress) -> FieldSample:
    soil, gravity = resolved.scene.particle_soil, resolved.scene.gravity_m_per_s2
    assert soil is not None
    sample = sample_under_law(resolved, edge_m, threads, on_progress)
    endless = _endless(soil, edge_m)
    settling = settling_under(resolved, 1, endless, gravity, on_progress)
    radius = soil.particles.mean_volume_radius_m
    rest = Rest(relaxed_rest(radius, settling.contact_rate_per_s).speed_m_per_s, RELAXING_S)
    damping = damping_per_s(soil, gravity)
    over_lower = soil.bin.depth_m + (HELD_LAYER + HEADROOM) * soil.particles.bounds_m[1]
    bed = settling.run(_in_layers(_stacked(sample, soil), soil), rest, damping, "relaxing")
    bed = _in_layers(_level(cut_to_depth(bed, radius, over_lower), soil), soil)
    engine = settling.settled(bed, with_patience(rest, bed, endless), damping, "relaxing")
    bed = _level(bed_of(engine, bed), soil)
    refuse_unfinished(bed, endless, rest.speed_m_per_s)
    order = np.argsort(bed.positions_m[:, 0], kind="stable")
    return FieldSample(bed.only(order), _contacts_of(engine, soil, order))


def _stacked(sample: Bed, soil: Soil) -> Bed:
    """Tiles on top of each other, from the held layer to a diameter above the surface."""
    edge, radii, largest = sample.periods_m[0], radii_of(sample, soil), soil.particles.bounds_m[1]
    surface = -headroom_m(soil)
    bottom, top = surface - soil.bin.depth_m - HELD_LAYER * largest, surface + 2.0 * largest
    inside = sample.positions_m - np.array((*sample.lower_m[:2], 0.0)) + (0.0, -0.5 * edge, top)
    below = np.arange(math.ceil((top - bottom) / edge))
    places = (inside[None] - edge * below[:, None, None] * (0.0, 0.0, 1.0)).reshape(-1, 3)
    kept = places[:, 2] >= bottom
    return Bed(
        places[kept],
        (0.0, -0.5 * edge, bottom - headroom_m(soil)),
        (edge, 0.5 * edge),
        radii_m=None if soil.particles.sizes is None else np.tile(radii, len(below))[kept],
        sides="endless",
        held=places[kept, 2] < surface - soil.bin.depth_m,
    )


def _level(bed: Bed, soil: Soil) -> Bed:
    """The bed with its mean top where the surface is."""
    rise = -headroom_m(soil) - mean_above_profile_m(bed, soil.particles.mean_volume_radius_m, None)
    risen = bed.positions_m + np.array((0.0, 0.0, rise))
    return dataclasses.replace(bed, positions_m=risen)


def _in_layers(bed: Bed, soil: Soil) -> Bed:
    """The bed whose particles have the material of the layer that they stand in."""
    if soil.layers is None:
        return bed
    depth = -headroom_m(soil) - bed.positions_m[:, 2]
    return dataclasses.replace(bed, materials=material_at(soil, depth))


def _contacts_of(engine: SoilEngine, soil: Soil, order: np.ndarray) -> Contacts:
    """Contacts of the particles of an engine, numbered as after they are put in `order`."""
    pair, history = engine.contact_histories()
    touching = (history != 0.0).any(axis=1)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    pair, history = place[pair[touching]], history[touching]
    turned = pair[:, 0] > pair[:, 1]
    history = np.where(turned[:, None], history * history_parity(soil.law), history)
    pair = np.sort(pair, axis=1)
    rows = np.lexsort((pair[:, 1], pair[:, 0]))
    return Contacts(pair[rows], history[rows])
