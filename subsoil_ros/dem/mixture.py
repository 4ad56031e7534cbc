"""Spheres of several sizes and materials: what a pair of them takes instead of the common numbers.

Contacts of unequal spheres: the reduced radius R = r1 r2 / (r1 + r2) and mass m = m1 m2 / (m1 + m2) scale the
numbers of the law, and both bodies reach to one point on the line of centres, the middle of overlap or gap.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..scene.pairs import boundary_values, layer_soils, particle_values, sphere_mass_kg
from ..scene.soil import Soil
from .contact import Features, PairLaw, pair_law

REST_OVERLAP, REACH = PairLaw._fields.index("rest_overlap"), PairLaw._fields.index("reach")
"""Columns of a table of laws."""


class Mixture(NamedTuple):
    """Particles as they are sorted, and the laws of one kind of contact between them.

    Arrays of particles have length 0 where all are equal. `laws` has the columns of PairLaw; its row is
    material_i * materials + material_j for two particles, material_i at a boundary. With sizes, the rows
    stand for a reduced radius of 1 m and a reduced mass of 1 kg.
    """

    radius: np.ndarray  # (n,) [m]
    mass: np.ndarray  # (n,) [kg]
    material: np.ndarray  # (n,) int64
    laws: np.ndarray  # (rows, 13) float64, SI
    materials: int


def law_tables(soil: Soil, features: Features) -> tuple[np.ndarray, np.ndarray]:
    """`laws` of a Mixture: for two particles (materials^2, 13), for particle and boundary (materials, 13)."""
    layers, sizes = layer_soils(soil), features.sizes.ndim == 2
    has_adhesion = features.adhesion.ndim == 2
    radius = 1.0 if sizes else soil.particles.mean_volume_radius_m
    masses = [1.0 if sizes else sphere_mass_kg(layer, radius) for layer in layers]
    pairs, boundaries = [], []
    for first, mass in zip(layers, masses, strict=True):
        at_boundary = boundary_values(first, radius, mass)
        boundaries.append(pair_law(at_boundary, radius, has_adhesion=has_adhesion))
        for second, other in zip(layers, masses, strict=True):
            reduced = (1.0, 1.0) if sizes else (0.5 * radius, mass * other / (mass + other))
            values = particle_values(first, second, *reduced)
            pairs.append(pair_law(values, reduced[0], has_adhesion=has_adhesion))
    return np.array(pairs, np.float64), np.array(boundaries, np.float64)


@njit(cache=True, inline="always", error_model="numpy")
def scaled_law(laws, row, radius, mass, features):
    """Row of a table of laws; with sizes at the reduced radius [m] and mass [kg] of a pair.

    K_Y R^2 and mu_r R of rolling. Hertz: stiffnesses with R^(1/2), dashpots with the root of stiffness times
    mass, R^(1/4) m^(1/2) (scene.pairs).
    """
    normal, damper = 1.0, 1.0
    if features.sizes.ndim == 2 and features.hertz.ndim == 2:
        normal = math.sqrt(radius)
        damper = math.sqrt(normal * mass)
    arm = radius if features.sizes.ndim == 2 else 1.0
    return PairLaw(
        normal * laws[row, 0], normal * laws[row, 1], damper * laws[row, 2], damper * laws[row, 3],
        laws[row, 4], laws[row, 5], laws[row, 6], laws[row, 7], laws[row, 8], laws[row, 9], laws[row, 10],
        normal * arm * arm * laws[row, 11], arm * laws[row, 12],
    )  # fmt: skip


@njit(cache=True, inline="always", error_model="numpy")
def pair_of(i, j, radius, mixture, features):
    """Radii [m] of particles i and j, and the law between them."""
    first, second = radius, radius
    if features.sizes.ndim == 2:
        first, second = mixture.radius[i], mixture.radius[j]
    row, mass = 0, 1.0
    if features.sizes.ndim == 2 or features.materials.ndim == 2:
        row = mixture.material[i] * mixture.materials + mixture.material[j]
        mass = mixture.mass[i] * mixture.mass[j] / (mixture.mass[i] + mixture.mass[j])
    return first, second, scaled_law(mixture.laws, row, first * second / (first + second), mass, features)


@njit(cache=True, inline="always", error_model="numpy")
def sphere_of(i, radius, law, mixture, features):
    """Radius [m] of particle i, and its law at a boundary."""
    own = radius
    if features.sizes.ndim == 2:
        own = mixture.radius[i]
    if features.sizes.ndim == 2 or features.materials.ndim == 2:
        law = scaled_law(mixture.laws, mixture.material[i], own, mixture.mass[i], features)
    return own, law


def material_at(soil: Soil, depth_m: np.ndarray) -> np.ndarray:
    """(n,) int64: the layer at each depth below z = 0, by number from the top; 0 without layers."""
    thicknesses = [layer.thickness_m for layer in soil.layers or () if layer.thickness_m is not None]
    return np.searchsorted(np.cumsum(thicknesses), depth_m, side="right").astype(np.int64)
