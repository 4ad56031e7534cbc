"""The bonds of a bed, stored beside the lists of neighbours, and the count of those that broke."""

import math
from collections.abc import Mapping

import numpy as np

from ...contact_laws.base import Features
from ...contact_laws.features import is_endless, is_periodic
from ...scene.pair_laws import particle_mass_kg
from ...scene.soil import Soil
from ..blocks import history_blocks, history_places
from ..neighbours import carry_pairs
from ..particles import PairList, Particles
from .kernel import PARITY, STATE, BondArrays, bond_sums, kept_count, stretch_bonds

SINKS = ("bond_dashpot", "bond_breakage")
"""Energy sinks of bonds, in the order of their book."""


class BondList:
    """Bonds of the particles of an engine, one place for every listed pair."""

    def __init__(self, soil: Soil, particles: Particles, kind: type, features: Features) -> None:
        assert soil.bonds is not None
        self._bonds, self._soil, self._kind, self._features = soil.bonds, soil, kind, features
        self._parity = PARITY[: kept_count(features)]
        self.state = self._blocks(0)
        self.book = np.zeros((0, len(SINKS)))  # (slabs, 2) since the lists were built
        self.made = np.zeros(particles.count, np.int32)  # bonds of each particle
        self.broken = np.zeros(particles.count, np.int32)  # broken ones of each, before the lists were built
        self.broken_count = 0  # of all, also of particles that a window removed
        self.lost_joule = np.zeros(len(SINKS))  # flushed
        self.known = 0
        """Particles before this identity have their bonds."""

    def _blocks(self, pairs: int) -> np.ndarray:
        return history_blocks(pairs, self._kind, len(self._parity))

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays that later steps depend on, and the counts."""
        names = ("state", "book", "made", "broken", "lost_joule")
        counts = np.array((self.known, self.broken_count))
        return {name: getattr(self, name) for name in names} | {"counts": counts}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Continue from `arrays`."""
        for name, array in arrays.items():
            if name != "counts":
                setattr(self, name, array)
        self.known, self.broken_count = arrays["counts"].tolist()

    def kernel_arrays(self) -> BondArrays:
        """Arrays for the kernels, valid until lists are rebuilt."""
        bonds, particles = self._bonds, self._soil.particles
        part, slope = 1.0 / bonds.stiffness_ratio, math.tan(math.radians(bonds.friction_angle_deg))
        mean = particles.mean_volume_radius_m
        shape = self._shape(np.array(mean), np.array(mean), np.array(0.5 * particle_mass_kg(self._soil)))
        numbers = (
            part, math.sqrt(part), bonds.tensile_strength_pa, bonds.cohesion_pa, slope, shape[0], *shape[2:],
        )  # fmt: skip
        return BondArrays(self.state, self.book, *np.array(numbers, self._kind))

    def _shape(self, one: np.ndarray, other: np.ndarray, reduced_mass: np.ndarray) -> tuple[np.ndarray, ...]:
        """SHAPE of bonds between particles of these radii."""
        radius = self._bonds.radius_over_particle * np.minimum(one, other)
        stiffness = self._bonds.youngs_modulus_pa * math.pi * radius**2 / (one + other)
        damper = 2.0 * self._bonds.damping_ratio * np.sqrt(stiffness * reduced_mass)
        return radius, 0.5 * (one - other), stiffness, damper

    def carry(self, order: np.ndarray, old: PairList, pairs: PairList) -> None:
        """Carry bonds over to the lists `pairs`, built after the particles were put in `order`. Broken ones
        are counted and left out."""
        self.flush()
        _, self.broken, self.broken_count = self._counted(old)
        state = self._blocks(len(pairs.neighbour))
        carry_pairs(
            order, old.row_start, old.neighbour, self.state, pairs.row_start, pairs.neighbour, state,
            self._parity,
        )  # fmt: skip
        lengths = history_places(np.arange(len(pairs.neighbour)), len(self._parity))[:, 0]
        state[lengths] = np.maximum(state[lengths], 0.0)
        self.state = state
        known = len(self.made)
        for name in ("made", "broken"):
            counts = np.append(getattr(self, name), 0)
            setattr(self, name, counts[np.minimum(order, known)])
        self.book = np.zeros((len(pairs.slab_start) - 1, len(SINKS)))

    def take(self, state: np.ndarray, counts: np.ndarray, slabs: int) -> None:
        """Go on from a state of the listed pairs, and the numbers made and broken of each particle before the
        lists were built, (n, 2), of another device."""
        self.state, self.book = state, np.zeros((slabs, len(SINKS)))
        before = int(self.broken.sum())
        self.made, self.broken = np.ascontiguousarray(counts[:, 0]), np.ascontiguousarray(counts[:, 1])
        self.broken_count += (int(self.broken.sum()) - before) // 2

    def add(self, pairs: PairList, p: Particles, laid_out_m: np.ndarray) -> None:
        """Make the bonds of particles that are new, between those that were laid out (n, 3) near enough."""
        known, self.known = self.known, int(p.identity.max(initial=-1)) + 1
        first, second = _ends(pairs)
        place = np.flatnonzero(np.maximum(p.identity[first], p.identity[second]) >= known)
        first, second = first[place], second[place]
        apart = laid_out_m[second] - laid_out_m[first]
        if is_periodic(self._features):
            apart[:, 1] -= _images(apart[:, 1], self._features.periodic)
        elif is_endless(self._features):
            apart -= _images(apart, self._features.periodic[0])
        length = np.linalg.norm(apart, axis=1)
        radius = p.radius if p.unequal else np.full(p.count, self._soil.particles.mean_volume_radius_m)
        one, other = radius[first], radius[second]
        near = length <= one + other + self._bonds.gap_over_radius * np.minimum(one, other)
        place, first, second = place[near], first[near], second[near]
        rows = np.zeros((len(place), len(self._parity)))
        rows[:, 0] = length[near]
        if len(self._parity) > len(STATE):
            reduced = p.mass[first] * p.mass[second] / (p.mass[first] + p.mass[second])
            rows[:, len(STATE) :] = np.stack(self._shape(radius[first], radius[second], reduced), axis=1)
        self.state[history_places(place, len(self._parity))] = rows
        for end in (first, second):
            np.add.at(self.made, end, 1)

    def flush(self) -> None:
        """Add the book to `lost_joule` and clear it."""
        self.lost_joule += self.book.sum(axis=0)
        self.book[:] = 0.0

    def _counted(self, pairs: PairList) -> tuple[int, np.ndarray, int]:
        """Whole bonds; (n,) broken ones of each particle; broken ones since the start."""
        first, second = _ends(pairs)
        lengths = self.state[history_places(np.arange(len(first)), len(self._parity))[:, 0]]
        gone = np.flatnonzero(lengths < 0.0)
        broken = self.broken.copy()
        for end in (first[gone], second[gone]):
            np.add.at(broken, end, 1)
        return int((lengths > 0.0).sum()), broken, self.broken_count + len(gone)

    def count(self, pairs: PairList) -> tuple[int, int]:
        """Whole bonds, and those broken since the start."""
        whole, _, broken = self._counted(pairs)
        return whole, broken

    def broken_part(self, pairs: PairList) -> np.ndarray:
        """(n,) float32: part of each particle's bonds that broke; 0 where it had none."""
        return np.asarray(self._counted(pairs)[1] / np.maximum(self.made, 1), np.float32)

    def sums(self, pairs: PairList, position: np.ndarray) -> tuple[float, np.ndarray]:
        """Stored energy [J], and force times distance (3, 3) [N m], compression positive."""
        arrays = self.kernel_arrays()
        stored, total = bond_sums(pairs, position, arrays, self._features)
        return float(stored), total

    def stretch(self, pairs: PairList, position: np.ndarray, strain: np.ndarray) -> None:
        """Update slips and turns after the bed was stretched by `strain` (3,)."""
        arrays = self.kernel_arrays()
        stretch_bonds(pairs, position, arrays, strain, self._features)


def _ends(pairs: PairList) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of both particles of every listed pair."""
    return np.repeat(np.arange(len(pairs.row_start) - 1), np.diff(pairs.row_start)), pairs.neighbour


def _images(apart_m: np.ndarray, period_m: np.ndarray) -> np.ndarray:
    """Whole periods in `apart_m`: less these, it leads to the nearest image."""
    return np.asarray(period_m * np.round(apart_m / period_m)).reshape(apart_m.shape)
