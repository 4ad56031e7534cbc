"""Pair laws of a scene: forces and distance of two bodies in contact."""

import math

from ..contact_laws.base import PairValues
from .bed_kinds import GridBed
from .soil import Soil


def sphere_mass_kg(soil: Soil, radius_m: float) -> float:
    """Mass of a sphere of this radius [kg]."""
    return soil.particles.density_kg_per_m3 * 4.0 / 3.0 * math.pi * radius_m**3


def particle_mass_kg(soil: Soil) -> float:
    """Mass of one sphere, the mean of spheres of several sizes [kg]."""
    return sphere_mass_kg(soil, soil.particles.mean_volume_radius_m)


def layer_soils(soil: Soil) -> tuple[Soil, ...]:
    """The soil of every layer as one without layers, from top to bottom; without layers the soil itself.

    Values that a layer does not give are those of `soil.particles` and `soil.law`.
    """
    if soil.layers is None:
        return (soil,)
    found = []
    for layer in soil.layers:
        density = layer.density_kg_per_m3 or soil.particles.density_kg_per_m3
        update: dict[str, object] = {
            "layers": None,
            "particles": soil.particles.model_copy(update={"density_kg_per_m3": density}),
        }
        if layer.law is not None:
            update["law"] = soil.law.changed_by(layer.law)
        found.append(soil.model_copy(update=update))
    return tuple(found)


def size_ratio(soil: Soil) -> float:
    """Radius of the particles over the radius that the law's values hold for."""
    radius = soil.particles.mean_volume_radius_m
    return radius / (soil.particles.reference_radius_m or radius)


def pair_values(soil: Soil) -> tuple[PairValues, PairValues]:
    """Laws of the pairs particle-particle and particle-boundary, two spheres of mean volume.

    For a soil with layers, the laws of `soil.law`; those of the layers come from `layer_soils`.
    """
    radius, mass = soil.particles.mean_volume_radius_m, particle_mass_kg(soil)
    return (
        particle_values(soil, soil, 0.5 * radius, 0.5 * mass),
        boundary_values(soil, radius, mass),
    )


def particle_values(first: Soil, second: Soil, radius_m: float, mass_kg: float) -> PairValues:
    """Law of two particles, one of each soil (without layers; the same one for a like pair).

    radius_m, mass_kg: reduced ones of the pair, r1 r2 / (r1 + r2) and m1 m2 / (m1 + m2). Values are scaled to
    the mean radius of the particles where the scene asks for it.
    """
    ratio = size_ratio(first)
    if first is second:
        return first.law.pair(ratio, radius_m, mass_kg)
    return first.law.mixed_pair(second.law, ratio, radius_m, mass_kg)


def boundary_values(soil: Soil, radius_m: float, mass_kg: float) -> PairValues:
    """Law of a particle of this radius and mass at a wall; soil without layers."""
    return soil.law.at_boundary(size_ratio(soil), radius_m, mass_kg)


def tool_values(soil: Soil) -> PairValues:
    """Law of particle and tool: that of the boundary with its normal stiffness times the tool's factor."""
    return pair_values(soil)[1].stiffened(soil.tool_stiffness_factor)


def rest_spacing_m(soil: Soil) -> float:
    """Centre to centre of a pair without load: 2 r - rest overlap [m].

    Spheres of several sizes: of two of mean volume. Layers that differ: the widest.
    """
    overlap = min(pair_values(layer)[0].rest_overlap for layer in layer_soils(soil))
    return 2.0 * soil.particles.mean_volume_radius_m - overlap


def particle_spacing_m(soil: Soil) -> float:
    """Spacing of a grid as given; without one (`rest`, and beds that are no grid) that without load [m]."""
    if isinstance(soil.bed, GridBed) and soil.bed.spacing_m != "rest":
        return soil.bed.spacing_m
    return rest_spacing_m(soil)
