"""A field of any length: strips of copies of one settled sample (dem.packing.field_sample).

1. Copies of the sample, which is periodic along x and y, tile the ground as squares do. A field lies across
   them at an angle, so that a tool meets each copy at another place of its width and the draft does not
   repeat itself from copy to copy. With periodic sides it lies along them, as its own period must be one of
   the ground. Cut to the width of the scene they make one period of the field (FieldPeriod).
2. Strips of the field are cut by the place of the particles along x. A particle's identity is the number of
   its period times the particles of a period, plus its number in the period; it gives the place where it was
   laid out.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ..contact_laws.base import SPRINGS
from ..errors import SceneError
from ..scene.soil import Soil
from .bed import Bed, profile_m, radii_of
from .contact import history_parity
from .periodic import HELD_LAYER
from .snapshot import bed_digest

STRIPS_PER_SAMPLE = 4
"""Strips in the edge of a sample: on average the window is an eighth of an edge longer than the scene's, and
lists are rebuilt for a shift more rarely than for the motion of particles."""

HEADROOM = 4.0
"""Free height over a sample, and below it, over the largest radius: no particle reaches an image."""

ALONG, ACROSS = ((1, 0), (0, 1)), ((21, 8), (13, 5))
"""Edges of a sample along the ground's x and y from a copy to the next one in its row, and to one in the row
beside. Rows go along the field. With numbers of Fibonacci, the places where a tool cuts through the copies
of a period are spread evenly over it: 8/22 of its edge from one to the next, 1/22 between the nearest."""


class Contacts(NamedTuple):
    """Contacts of a sample with their histories."""

    pair: np.ndarray  # (p, 2) int64, numbers of the particles; the first is the smaller
    history: np.ndarray  # (p, components), as the first of each sees its contact


class FieldSample(NamedTuple):
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
    """Free height over a sample and below it [m]."""
    return HEADROOM * soil.particles.bounds_m[1]


class FieldPeriod(NamedTuple):
    """Particles of one period of a field, sorted by x."""

    period_m: float
    half_width_m: float
    samples: float  # edges of a sample in its length
    place_m: np.ndarray  # (n, 3), 0 <= x < period_m
    number: np.ndarray  # (n,) of the particle in the sample
    turn: np.ndarray  # (2, 2), rotation of x and y of vectors from the sample to the field

    def turned(self, history: np.ndarray) -> np.ndarray:
        """(p, components) histories of the sample's contacts in the field: springs turn, a law's own numbers
        do not."""
        found = history.copy()
        for x in range(0, SPRINGS, 3):
            found[:, x : x + 2] = history[:, x : x + 2] @ self.turn.T
        return found


def field_period(bed: Bed, width_m: float, sides: str) -> FieldPeriod:
    """One period of a field of this width; the sample's square has its corner at the bed's lower x and y.

    With periodic sides the width is rounded to whole samples.
    """
    edge = bed.periods_m[0]
    half_width = 0.5 * (edge * max(1, round(width_m / edge)) if sides == "periodic" else width_m)
    next_in_row, beside = np.array(ALONG if sides == "periodic" else ACROSS)
    samples = math.hypot(*next_in_row)
    turn = np.array((next_in_row, (-next_in_row[1], next_in_row[0]))) / samples
    shift, apart = edge * (turn @ beside)
    period = edge * samples
    first = (bed.positions_m[:, :2] - bed.lower_m[:2]) @ turn.T - (0.0, half_width)
    lowest = math.floor((-half_width - first[:, 1].max()) / apart)
    highest = math.ceil((half_width - first[:, 1].min()) / apart)
    copies = []
    for row in range(lowest, highest + 1):
        x, y = first[:, 0] + row * shift, first[:, 1] + row * apart
        inside = np.flatnonzero((y >= -half_width) & (y < half_width))
        x = x[inside] % period
        x[x >= period] = 0.0  # rounded up from just below zero
        place = np.column_stack((x, y[inside], bed.positions_m[inside, 2]))
        copies.append((place, inside))
    place, number = (np.concatenate(parts) for parts in zip(*copies, strict=True))
    order = np.argsort(place[:, 0], kind="stable")
    return FieldPeriod(period, half_width, samples, place[order], number[order], turn)


class Field:
    """A field of a scene, in strips of length `strip_m` from x = 0 on, without record of what it laid out."""

    def __init__(self, sample: FieldSample, soil: Soil) -> None:
        self._sample, self._soil = sample, soil
        self._largest = soil.particles.bounds_m[1]
        period = field_period(sample.bed, soil.bin.width_m, soil.bin.sides)
        self._strips = round(STRIPS_PER_SAMPLE * period.samples)
        self.period_m, self.strip_m = period.period_m, period.period_m / self._strips
        self.count = max(1, round(soil.bin.length_m / self.strip_m))
        self._half_width, self._floor = period.half_width_m, sample.bed.lower_m[2] + headroom_m(soil)
        radius = radii_of(sample.bed, soil)[period.number]
        fits = np.abs(period.place_m[:, 1]) + radius * (soil.bin.sides == "walls") <= self._half_width
        self._place = period.place_m[fits] + np.array((0.0, 0.0, headroom_m(soil)))
        self._number, self._radius = period.number[fits], radius[fits]
        self._start = np.searchsorted(self._place[:, 0], self.strip_m * np.arange(self._strips + 1))
        self._start[-1] = len(self._place)
        self._top_m = float((self._place[:, 2] + self._radius).max())
        assert sample.bed.held is not None
        self._held = sample.bed.held[self._number]
        if soil.bin.sides == "held":
            self._held |= np.abs(self._place[:, 1]) > self._half_width - self.layer_m
        most = np.iinfo(np.int32).max // len(self._place) * self.period_m
        if self.count * self.strip_m > most:
            raise SceneError(
                f"soil.bin.length_m: {soil.bin.length_m:g} m given; identities (int32) of particles of "
                f"this size suffice for {most:.0f} m at most; make the field shorter"
            )
        first, second = sample.contacts.pair.T
        self._key = first * len(sample.bed.positions_m) + second
        assert (np.diff(self._key) > 0).all()
        self._parity, self._history = history_parity(soil.law), period.turned(sample.contacts.history)

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
        materials = self._sample.bed.materials
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
        key = np.where(turned, other, one) * len(self._sample.bed.positions_m) + np.where(turned, one, other)
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
