"""A field of any length: strips of one settled block (dem.beds.block) that repeats itself along x.

1. Copies of the block, cut to the width of the scene, make the plot, one period of the field (plot).
2. Strips of the field are cut by the place of the particles along x. A particle's identity is the number of
   its period times the particles of the plot, plus its number in the plot; it gives the place of laying out.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ..errors import SceneError
from ..scene.soil import Soil
from .bed import Bed, profile_m, radii_of
from .contact import history_parity
from .periodic import HELD_LAYER
from .plot import plot_of
from .snapshot import bed_digest

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


def headroom_m(soil: Soil) -> float:
    """Free height over a block and below it [m]."""
    return HEADROOM * soil.particles.bounds_m[1]


class Field:
    """A field of a scene, in strips of length `strip_m` from x = 0 on, without record of what it laid out."""

    def __init__(self, block: Block, soil: Soil) -> None:
        self._block, self._soil = block, soil
        self._largest = soil.particles.bounds_m[1]
        plot = plot_of(block.bed, soil.bin.width_m, soil.bin.sides)
        self._strips = round(STRIPS_PER_BLOCK * plot.blocks)
        self.period_m, self.strip_m = plot.period_m, plot.period_m / self._strips
        self.count = max(1, round(soil.bin.length_m / self.strip_m))
        self._half_width, self._floor = plot.half_width_m, block.bed.lower_m[2] + headroom_m(soil)
        radius = radii_of(block.bed, soil)[plot.number]
        fits = np.abs(plot.place_m[:, 1]) + radius * (soil.bin.sides == "walls") <= self._half_width
        self._place = plot.place_m[fits] + np.array((0.0, 0.0, headroom_m(soil)))
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
    def ends_m(self) -> tuple[float, float]:
        """x of both ends [m]."""
        return 0.0, self.count * self.strip_m

    @property
    def places_m(self) -> np.ndarray:
        """(n, 3) places of one period [m]."""
        return self._place

    def digest(self) -> np.ndarray:
        """(32,) uint8 of the first window and of all from which strips follow."""
        parts = (self._place, self._radius, self._history)
        return bed_digest(self.box(*self.first_window), np.concatenate([part.ravel() for part in parts]))
