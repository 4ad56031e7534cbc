"""Ground from which a field is laid out: a block periodic along x and y, or a whole period if it is graded.

The sizes of a graded bed depend on the distance from the path of the tools, and the copies of a block do not
lie along it. So a whole period is pressed (graded), cut to the section of the field, and comes to rest
between periodic ends, its sides held unless they are periodic too.
"""

import dataclasses

import numpy as np

from ...loading.loader import ResolvedScene
from ...scene.bin import Bin
from ...scene.soil import Soil
from ..bed import Bed
from ..periodic import HELD_LAYER
from .cache import cached_bed_path, keep, load_cached, load_contacts
from .dense import relaxed_rest
from .field import Block, Contacts, contacts_of, headroom_m, kept_block
from .plot import blocks_of
from .settling import (
    EngineOf,
    OnProgress,
    Rest,
    bed_of,
    ignore_progress,
    of_the_preparation,
)  # fmt: skip
from .surface import cut_to_depth, top_surface_m
from .tile import tile_edge_m
from .tiled import (
    RELAXING_S,
    damping_per_s,
    graded_under_law,
    refuse_unfinished,
    settling_under,
    with_patience,
)  # fmt: skip


def kept_ground(
    resolved: ResolvedScene, engine_of: EngineOf, threads: int = 1, on_progress: OnProgress = ignore_progress
) -> Block:
    """Ground of a scene's field, from the cache if it is there.

    Raises:
        SceneError: see field.kept_block.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None
    if soil.particles.coarse is None:
        return kept_block(resolved, engine_of, threads, on_progress)
    edge = tile_edge_m(soil)
    path, as_kept = cached_bed_path(resolved), _period(soil, edge)
    bed, contacts = load_cached(path, as_kept), load_contacts(path)
    if bed is not None and contacts is not None:
        return Block(bed, Contacts(*contacts))
    ground = _prepared(resolved, soil, edge, engine_of, threads, on_progress)
    keep(path, ground.bed, as_kept, ground.contacts)
    return ground


def _period(soil: Soil, edge_m: float) -> Soil:
    """The soil in the periodic box of one period of the field; held sides have headroom too."""
    aside = 0.0 if soil.bin.sides == "periodic" else 2.0 * headroom_m(soil)
    box = Bin(
        length_m=edge_m * blocks_of(soil.bin.sides),
        width_m=soil.bin.width_m + aside,
        depth_m=soil.bin.depth_m + headroom_m(soil),
    ).model_copy(update={"sides": "endless"})
    return soil.model_copy(update={"bin": box, "window": None, "surface": None} | of_the_preparation(soil))


def _prepared(
    resolved: ResolvedScene,
    soil: Soil,
    edge_m: float,
    engine_of: EngineOf,
    threads: int,
    on_progress: OnProgress,
) -> Block:
    bed, period = _laid(resolved, soil, edge_m, engine_of, threads, on_progress), _period(soil, edge_m)
    gravity = resolved.scene.gravity_m_per_s2
    settling = settling_under(resolved, engine_of, threads, period, gravity, on_progress)
    radius = soil.particles.mean_volume_radius_m
    rest = Rest(relaxed_rest(radius, settling.contact_rate_per_s).speed_m_per_s, RELAXING_S)
    damping = damping_per_s(soil, gravity)
    moved = settling.run(_stuck(bed, soil), rest, damping, "relaxing")
    bed = dataclasses.replace(moved, held=bed.held).only(_inside(moved, soil))
    stuck = _stuck(bed, soil)
    engine = settling.settled(stuck, with_patience(rest, stuck, period), damping, "relaxing")
    bed = _level(dataclasses.replace(bed_of(engine, stuck), held=bed.held), soil)
    refuse_unfinished(bed, period, rest.speed_m_per_s)
    order = np.argsort(bed.positions_m[:, 0], kind="stable")
    return Block(bed.only(order), contacts_of(engine, soil, order))


def _laid(
    resolved: ResolvedScene,
    soil: Soil,
    edge_m: float,
    engine_of: EngineOf,
    threads: int,
    on_progress: OnProgress,
) -> Bed:
    """A period of the field from the held layer to the surface, cut at its sides."""
    largest, room = soil.particles.bounds_m[1], headroom_m(soil)
    above, below = 2.0 * largest, HELD_LAYER * largest
    size = edge_m * blocks_of(soil.bin.sides), soil.bin.width_m, above + soil.bin.depth_m + below
    whole = graded_under_law(resolved, size, above, engine_of, threads, on_progress)
    bed = cut_to_depth(whole, soil.particles.mean_volume_radius_m, -whole.lower_m[2] - above)
    place = bed.positions_m + np.array((0.0, 0.0, above - room))
    periodic = soil.bin.sides == "periodic"
    half = 0.5 * bed.periods_m[1] if periodic else 0.5 * soil.bin.width_m
    lowest = -room - soil.bin.depth_m - below
    kept = (place[:, 2] >= lowest) & (np.abs(place[:, 1]) <= half)
    aside = half if periodic else half + room
    return dataclasses.replace(
        bed,
        positions_m=place,
        lower_m=(0.0, -aside, lowest - room),
        upper_m=(bed.upper_m[0], aside),
        held=place[:, 2] < -room - soil.bin.depth_m,
    ).only(kept)


def _stuck(bed: Bed, soil: Soil) -> Bed:
    """The bed with its sides held, unless they are periodic."""
    assert bed.held is not None
    if soil.bin.sides == "periodic":
        return bed
    free = 0.5 * soil.bin.width_m - HELD_LAYER * soil.particles.bounds_m[1]
    return dataclasses.replace(bed, held=bed.held | (np.abs(bed.positions_m[:, 1]) > free))


def _inside(bed: Bed, soil: Soil) -> np.ndarray:
    """(n,) bool: particles that did not fall off at an open side."""
    assert bed.held is not None
    x = bed.positions_m
    found = x[:, 2] >= x[bed.held, 2].min()
    return found if soil.bin.sides == "periodic" else found & (np.abs(x[:, 1]) <= 0.5 * soil.bin.width_m)


def _level(bed: Bed, soil: Soil) -> Bed:
    """The bed with its mean top, away from held sides, where the surface is."""
    top = top_surface_m(bed, soil.particles.mean_volume_radius_m)
    columns = (np.arange(top.shape[1]) + 0.5) / top.shape[1] - 0.5
    free = 0.5 * soil.bin.width_m - HELD_LAYER * soil.particles.bounds_m[1]
    inside = np.abs(columns) * bed.periods_m[1] < (np.inf if soil.bin.sides == "periodic" else free)
    rise = -headroom_m(soil) - float(top[:, inside].mean())
    return dataclasses.replace(bed, positions_m=bed.positions_m + np.array((0.0, 0.0, rise)))
