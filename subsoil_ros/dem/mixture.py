"""Spheres of several sizes and materials: the numbers of each pair, in place of common ones.

Contacts of unequal spheres: the reduced radius R = r1 r2 / (r1 + r2) and mass m = m1 m2 / (m1 + m2) scale the
numbers of the law, and both bodies reach to one point on the line of centres, the middle of overlap or gap.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ..contact_laws.base import Features
from ..contact_laws.features import has_sizes, is_unlike
from ..scene.pair_laws import boundary_values, layer_soils, pair_values, particle_values, sphere_mass_kg
from ..scene.soil import Soil
from .contact import at_size, numbers_at


class Mixture(NamedTuple):
    """Particles as they are sorted, and the laws of one kind of contact.

    Arrays of particles have length 0 where all are equal. `laws` has the columns of ContactLaw.numbers; row
    material_i * materials + material_j is for two particles, row material_i at a boundary. With sizes, they
    stand for a reduced radius of 1 m and a reduced mass of 1 kg.
    """

    common_radius: float  # [m] of equal particles
    radius: np.ndarray  # (n,) [m]
    mass: np.ndarray  # (n,) [kg]
    material: np.ndarray  # (n,) int64
    laws: np.ndarray  # (rows, numbers) float64, SI
    materials: int


class ContactModel(NamedTuple):
    """What all contacts of one kind have in common, for kernels.

    Parallel kernels take these one by one, because numba does not pass nested tuples into their loops.
    """

    law: Any  # ContactLaw.numbers of equal particles of one material; of others only its class counts
    mixture: Mixture
    features: Features
    step: float  # [s]


def law_tables(soil: Soil, features: Features) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`laws` of a Mixture: for two particles (materials^2, numbers), for particle and wall, and for particle
    and tool (materials, numbers)."""
    layers, sizes = layer_soils(soil), has_sizes(features)
    radius = 1.0 if sizes else soil.particles.mean_volume_radius_m
    masses = [1.0 if sizes else sphere_mass_kg(layer, radius) for layer in layers]
    pairs, boundaries, tools = [], [], []
    for first, mass in zip(layers, masses, strict=True):
        at_boundary = boundary_values(first, radius, mass)
        at_tool = at_boundary.stiffened(soil.tool_stiffness_factor)
        boundaries.append(soil.law.numbers_of(at_boundary, radius))
        tools.append(soil.law.numbers_of(at_tool, radius))
        for second, other in zip(layers, masses, strict=True):
            reduced = (1.0, 1.0) if sizes else (0.5 * radius, mass * other / (mass + other))
            values = particle_values(first, second, *reduced)
            pairs.append(soil.law.numbers_of(values, reduced[0]))
    return np.array(pairs, np.float64), np.array(boundaries, np.float64), np.array(tools, np.float64)


def reaches_m(soil: Soil) -> tuple[float, float]:
    """Largest gaps across which two particles, and a particle and a boundary, interact."""
    layers = layer_soils(soil)
    boundaries = [pair_values(layer)[1] for layer in layers]
    if not any(value.adhesion > 0.0 for layer in layers for value in pair_values(layer)):
        return 0.0, 0.0
    pairs = [particle_values(first, second, 1.0, 1.0) for first in layers for second in layers]
    return max(value.reach for value in pairs), max(value.reach for value in boundaries)


@njit(cache=True, inline="always", error_model="numpy")
def pair_of(i, j, law, mixture, features):
    """Radii [m] of particles i and j, and the law between them; only the class of `law` is used."""
    first, second = mixture.common_radius, mixture.common_radius
    if has_sizes(features):
        first, second = mixture.radius[i], mixture.radius[j]
    row = 0
    if is_unlike(features):
        row = mixture.material[i] * mixture.materials + mixture.material[j]
    between = numbers_at(mixture.laws[row], 0, 1, law)
    if has_sizes(features):
        mass = mixture.mass[i] * mixture.mass[j] / (mixture.mass[i] + mixture.mass[j])
        between = at_size(between, first * second / (first + second), mass)
    return first, second, between


@njit(cache=True, inline="always", error_model="numpy")
def sphere_of(i, law, mixture, features):
    """Radius [m] of particle i, and its law at a boundary."""
    own = mixture.common_radius
    if has_sizes(features):
        own = mixture.radius[i]
    if is_unlike(features):
        law = numbers_at(mixture.laws[mixture.material[i]], 0, 1, law)
    if has_sizes(features):
        law = at_size(law, own, mixture.mass[i])
    return own, law


def material_at(soil: Soil, depth_m: np.ndarray) -> np.ndarray:
    """(n,) int64: the layer at each depth below z = 0, by number from the top; 0 without layers."""
    thicknesses = [layer.thickness_m for layer in soil.layers or () if layer.thickness_m is not None]
    return np.searchsorted(np.cumsum(thicknesses), depth_m, side="right").astype(np.int64)
