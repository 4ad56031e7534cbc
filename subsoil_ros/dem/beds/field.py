"""A field of any length: strips of one settled block that repeats itself along x.

1. A tile of random spheres (dem.beds.tile) under the law of the scene, stacked as deep as the bed over held
   soil, comes to rest in its weight between periodic sides along x and y. It is cut at its surface and
   comes to rest once more. With the springs that its contacts then have, that is the block.
2. Copies of the block, cut to the width of the scene, make the plot, one period of the field (plot).
3. Strips of the field are cut by the place of the particles along x. A particle's identity is the number of
   its period times the particles of the plot, plus its number in the plot; it gives the place of laying out.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ...errors import SceneError
from ...loading.loader import ResolvedScene
from ...scene.bin import Bin
from ...scene.soil import Soil
from ..bed import Bed
from ..contact import history_parity
from ..mixture import material_at
from ..periodic import HELD_LAYER
from .cache import cached_bed_path, keep, load_cached, load_contacts
from .dense import relaxed_rest
from .in_reach import radii_of
from .plot import plot_of
from .settling import (
    EngineOf,
    OnProgress,
    Rest,
    SettlingEngine,
    bed_of,
    ignore_progress,
    of_the_preparation,
)  # fmt: skip
from .surface import cut_to_depth, mean_above_profile_m, profile_m
from .tile import tile_edge_m
from .tiled import (
    RELAXING_S,
    damping_per_s,
    refuse_unfinished,
    settling_under,
    tile_under_law,
    with_patience,
)  # fmt: skip

STRIPS_PER_BLOCK = 4
"""Strips in the length of a block: on average the window is an eighth of a block longer than the scene's, and
lists are rebuilt for a shift more rarely than for the motion of particles."""

HEADROOM = 4.0
"""Free height over a block, and below it, over the largest radius: no particle reaches an image."""


class Contacts(NamedTuple):
    """Contacts of a block with their histories."""

    pair: np.ndarray  # (p, 2) int64, numbers of the particles; the first is the smaller
    history: np.ndarray  # (p, components), as the first of each sees its contact


class Block(NamedTuple):
    """Soil at rest, periodic along x and y."""

    bed: Bed  # endless, particles sorted by x; its mean top is HEADROOM below z = 0
    contacts: Contacts


class Strips(NamedTuple):
    """Particles of some strips of a field, as they were laid out."""

    identity: np.ndarray  # (n,) int32
    position_m: np.ndarray  # (n, 3)
    radius_m: np.ndarray  # (n,)
    material: np.ndarray  # (n,) int64


def kept_block(
    resolved: ResolvedScene, engine_of: EngineOf, threads: int = 1, on_progress: OnProgress = ignore_progress
) -> Block:
    """The block of a scene's field, from the cache if it is there.

    Raises:
        SceneError: the tile does not fit, changes its solid fraction under the law, or does not come to rest.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None
    edge = tile_edge_m(soil)
    path, as_kept = cached_bed_path(resolved), _endless(soil, edge)
    bed, contacts = load_cached(path, as_kept), load_contacts(path)
    if bed is not None and contacts is not None:
        return Block(bed, Contacts(*contacts))
    block = _prepared(resolved, edge, engine_of, threads, on_progress)
    keep(path, block.bed, as_kept, block.contacts)
    return block


def _endless(soil: Soil, edge_m: float) -> Soil:
    """The soil of a scene, layers and all, in a box that repeats itself, its surface below the top."""
    box = Bin(length_m=edge_m, width_m=edge_m, depth_m=soil.bin.depth_m + _headroom_m(soil))
    box = box.model_copy(update={"sides": "endless"})
    return soil.model_copy(update={"bin": box, "window": None, "surface": None} | of_the_preparation(soil))


def _headroom_m(soil: Soil) -> float:
    """Free height over a block and below it [m]."""
    return HEADROOM * soil.particles.bounds_m[1]


def _prepared(
    resolved: ResolvedScene, edge_m: float, engine_of: EngineOf, threads: int, on_progress: OnProgress
) -> Block:
    soil, gravity = resolved.scene.particle_soil, resolved.scene.gravity_m_per_s2
    assert soil is not None
    tile = tile_under_law(resolved, edge_m, engine_of, threads, on_progress)
    endless = _endless(soil, edge_m)
    settling = settling_under(resolved, engine_of, 1, endless, gravity, on_progress)
    radius = soil.particles.mean_volume_radius_m
    rest = Rest(relaxed_rest(radius, settling.contact_rate_per_s).speed_m_per_s, RELAXING_S)
    damping = damping_per_s(soil, gravity)
    over_lower = soil.bin.depth_m + (HELD_LAYER + HEADROOM) * soil.particles.bounds_m[1]
    bed = settling.run(_in_layers(_stacked(tile, soil), soil), rest, damping, "relaxing")
    bed = _in_layers(_level(cut_to_depth(bed, radius, over_lower), soil), soil)
    engine = settling.settled(bed, with_patience(rest, bed, endless), damping, "relaxing")
    bed = _level(bed_of(engine, bed), soil)
    refuse_unfinished(bed, endless, rest.speed_m_per_s)
    order = np.argsort(bed.positions_m[:, 0], kind="stable")
    return Block(bed.only(order), _contacts_of(engine, soil, order))


def _stacked(tile: Bed, soil: Soil) -> Bed:
    """Tiles on top of each other, from the held layer to a diameter above the surface."""
    edge, radii, largest = tile.periods_m[0], radii_of(tile, soil), soil.particles.bounds_m[1]
    surface = -_headroom_m(soil)
    bottom, top = surface - soil.bin.depth_m - HELD_LAYER * largest, surface + 2.0 * largest
    inside = tile.positions_m - np.array((*tile.lower_m[:2], 0.0)) + (0.0, -0.5 * edge, top)
    below = np.arange(math.ceil((top - bottom) / edge))
    places = (inside[None] - edge * below[:, None, None] * (0.0, 0.0, 1.0)).reshape(-1, 3)
    kept = places[:, 2] >= bottom
    return Bed(
        places[kept],
        (0.0, -0.5 * edge, bottom - _headroom_m(soil)),
        (edge, 0.5 * edge),
        radii_m=None if soil.particles.sizes is None else np.tile(radii, len(below))[kept],
        sides="endless",
        held=places[kept, 2] < surface - soil.bin.depth_m,
    )


def _level(bed: Bed, soil: Soil) -> Bed:
    """The bed with its mean top where the surface is."""
    rise = -_headroom_m(soil) - mean_above_profile_m(bed, soil.particles.mean_volume_radius_m, None)
    risen = bed.positions_m + np.array((0.0, 0.0, rise))
    return dataclasses.replace(bed, positions_m=risen)


def _in_layers(bed: Bed, soil: Soil) -> Bed:
    """The bed whose particles have the material of the layer that they stand in."""
    if soil.layers is None:
        return bed
    depth = -_headroom_m(soil) - bed.positions_m[:, 2]
    return dataclasses.replace(bed, materials=material_at(soil, depth))


def _contacts_of(engine: SettlingEngine, soil: Soil, order: np.ndarray) -> Contacts:
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


class Field:
    """A field of a scene, in strips of length `strip_m` from x = 0 on, without record of what it laid out."""

    def __init__(self, block: Block, soil: Soil) -> None:
        self._block, self._soil = block, soil
        self._largest = soil.particles.bounds_m[1]
        plot = plot_of(block.bed, soil.bin.width_m, soil.bin.sides)
        self._strips = round(STRIPS_PER_BLOCK * plot.blocks)
        self.period_m, self.strip_m = plot.period_m, plot.period_m / self._strips
        self.count = max(1, round(soil.bin.length_m / self.strip_m))
        self._half_width, self._floor = plot.half_width_m, block.bed.lower_m[2] + _headroom_m(soil)
        radius = radii_of(block.bed, soil)[plot.number]
        fits = np.abs(plot.place_m[:, 1]) + radius * (soil.bin.sides == "walls") <= self._half_width
        self._place = plot.place_m[fits] + np.array((0.0, 0.0, _headroom_m(soil)))
        self._number, self._radius = plot.number[fits], radius[fits]
        self._start = np.searchsorted(self._place[:, 0], self.strip_m * np.arange(self._strips + 1))
        self._start[-1] = len(self._place)
        self._top_m = float((self._place[:, 2] + self._radius).max())
        assert block.bed.held is not None
        self._held = block.bed.held[self._number]
        if soil.bin.sides == "held":
            self._held |= np.abs(self._place[:, 1]) > self._half_width - self.layer_m
        most = np.iinfo(np.int32).max // len(self._place) * self.period_m
        if self.count * self.strip_m > most:
            raise SceneError(
                f"soil.bin.length_m: {soil.bin.length_m:g} m given; identities (int32) of particles of "
                f"this size suffice for {most:.0f} m at most; make the field shorter"
            )
        first, second = block.contacts.pair.T
        self._key = first * len(block.bed.positions_m) + second
        assert (np.diff(self._key) > 0).all()
        self._parity, self._history = history_parity(soil.law), plot.turned(block.contacts.history)

    @property
    def layer_m(self) -> float:
        """Thickness of the layers that are held at open ends and sides."""
        return HELD_LAYER * self._largest

    def box(self, rear: int, front: int) -> Bed:
        """Walls about strips rear <= m < front, without particles. Loose particles stay between them."""
        lower = (rear * self.strip_m, -self._half_width, self._floor)
        return Bed(
            np.empty((0, 3)), lower, (front * self.strip_m, self._half_width), sides=self._soil.bin.bed_sides
        )

    def first_identity(self, strip: int) -> int:
        """Identity of the first particle of a strip."""
        period, part = divmod(strip, self._strips)
        return period * len(self._place) + int(self._start[part])

    def strips(self, first: int, last: int) -> Strips:
        """Particles of strips first <= m < last, those that reach above the surface left out. At both ends of
        the field they stand behind a wall."""
        identity = np.arange(self.first_identity(first), self.first_identity(last))
        place, k = self.laid_out_m(identity), identity % len(self._place)
        radius = self._radius[k]
        kept = (place[:, 0] >= radius) & (place[:, 0] <= self.count * self.strip_m - radius)
        if self._soil.surface is not None:
            kept &= place[:, 2] + radius <= self._top_m + profile_m(self._soil.surface, place[:, 0])
        materials = self._block.bed.materials
        material = np.zeros(len(k), np.int64) if materials is None else materials[self._number[k]]
        return Strips(identity[kept].astype(np.int32), place[kept], radius[kept], material[kept])

    def laid_out_m(self, identity: np.ndarray) -> np.ndarray:
        """(n, 3) [m] where particles were laid out."""
        period, k = np.divmod(identity.astype(np.int64), len(self._place))
        return self._place[k] + (period * self.period_m)[:, None] * (1.0, 0.0, 0.0)

    def held(self, identity: np.ndarray, x_m: np.ndarray, rear: int, front: int) -> np.ndarray:
        """(n,) bool: particles that are held while strips rear <= m < front exist; `x_m` is where they are.

        At the ends of the field, walls take the place of held particles.
        """
        found = self._held[identity % len(self._place)]
        if rear > 0:
            found = found | (x_m < rear * self.strip_m + self.layer_m)
        if front < self.count:
            found = found | (self.laid_out_m(identity)[:, 0] >= front * self.strip_m - self.layer_m)
        return found

    def histories(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """(p, components) histories of contacts of particles by identity, as laid out; zero without one."""
        one, other = self._number[first % len(self._place)], self._number[second % len(self._place)]
        turned = one > other
        if len(self._key) == 0:  # a law without springs
            return np.zeros((len(first), len(self._parity)))
        key = np.where(turned, other, one) * len(self._block.bed.positions_m) + np.where(turned, one, other)
        row = np.minimum(np.searchsorted(self._key, key), len(self._key) - 1)
        found = self._history[row] * (self._key[row] == key)[:, None]
        return np.where(turned[:, None], found * self._parity, found)

    def strips_about(self, low_m: float, high_m: float) -> tuple[int, int]:
        """Strips rear <= m < front that a window about tools from `low_m` to `high_m` needs."""
        window = self._soil.window
        assert window is not None
        rear = math.floor((low_m - window.behind_m) / self.strip_m)
        front = math.ceil((high_m + window.ahead_m) / self.strip_m)
        return min(max(rear, 0), self.count - 1), min(max(front, 1), self.count)

    def bed(self, rear: int, front: int) -> Bed:
        """Strips rear <= m < front as a bed."""
        laid, soil = self.strips(rear, front), self._soil
        return dataclasses.replace(
            self.box(rear, front),
            positions_m=laid.position_m,
            radii_m=None if soil.particles.sizes is None else laid.radius_m,
            materials=laid.material if soil.layers is not None else None,
            held=self.held(laid.identity, laid.position_m[:, 0], rear, front),
        )

    @property
    def first_window(self) -> tuple[int, int]:
        """Strips of a window at the beginning of the field."""
        window = self._soil.window
        assert window is not None
        return 0, min(self.count, math.ceil((window.ahead_m + window.behind_m) / self.strip_m) + 1)

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """Arrays from which all strips follow: places in a period [m], radii [m], histories."""
        return self._place, self._radius, self._history
