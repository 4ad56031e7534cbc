"""Larger or smaller particles for the same soil.

A bed of spheres of diameter d and density rho under a law with stiffness K, damping C, attraction K_B
delta_B and distances delta_c, delta_B behaves as a continuum of modulus K / d, strength K_B delta_B / d^2
and damping ratio C / sqrt(K m), with m ~ rho d^3. With s the ratio of radii these stay what they are for

    K, K_t, K_B ~ s    C ~ s^2    delta_c, delta_B ~ s    friction, rho ~ 1

and so do stress, strain, density and every other number without dimension: forces of contacts grow with
s^2, overlaps and the time step (~ sqrt(m / K)) with s. What is lost is what is as small as a particle: the
width of a shear band, the roughness of a surface, the teeth of a tool. Materials (law `hertz_mindlin`) need
no scaling: their stiffness already follows from a modulus.

The pair laws apply it (pairs.py) where a scene gives `particles.law_radius_m`.
"""

import math

from ..errors import InputError
from .beds import GridBed, SavedBed
from .pairs import PairValues
from .soil import Soil


def scaled_soil(soil: Soil, radius_m: float) -> Soil:
    """The same soil of particles with another radius; bin and surface stay, lengths of the grid grow along.

    Raises:
        InputError: the bed is a saved one, whose particles have their size, or there are several sizes.
    """
    if soil.particles.radius_m is None:
        raise InputError("soil.particles.sizes: another radius is for equal spheres; give particles.radius_m")
    if isinstance(soil.bed, SavedBed):
        raise InputError(
            f"soil.bed.kind: a saved bed keeps its radius {soil.particles.radius_m:g} m; use 'grid' or "
            "'dense_random', which are prepared anew"
        )
    ratio = radius_m / soil.particles.radius_m
    particles = soil.particles.model_copy(
        update={
            "radius_m": radius_m,
            "law_radius_m": soil.particles.law_radius_m or soil.particles.radius_m,
        }
    )
    changes: dict[str, object] = {"particles": particles, "skin_m": ratio * soil.skin_m}
    if isinstance(soil.bed, GridBed):
        spacing = soil.bed.spacing_m
        changes["bed"] = soil.bed.model_copy(
            update={
                "spacing_m": spacing if spacing == "rest" else ratio * spacing,
                "jitter_m": ratio * soil.bed.jitter_m,
            }
        )
    if soil.time_step_s != "auto":
        changes["time_step_s"] = ratio * soil.time_step_s
    if soil.largest_tool_overlap_m is not None:
        changes["largest_tool_overlap_m"] = ratio * soil.largest_tool_overlap_m
    return soil.model_copy(update=changes)


def dimensionless(
    values: PairValues, diameter_m: float, density_kg_per_m3: float, stress_pa: float
) -> dict[str, float]:
    """Numbers that say how a bed behaves: two with the same numbers are the same soil."""
    mass = density_kg_per_m3 * math.pi / 6.0 * diameter_m**3
    linear = values.linear_at(values.loaded_m(stress_pa * diameter_m**2))
    return {
        "stiffness": linear.stiffness / (stress_pa * diameter_m),
        "tangential stiffness": linear.tangential_stiffness / linear.stiffness,
        "damping ratio": linear.damping / math.sqrt(4.0 * linear.stiffness * 0.5 * mass),
        "tangential damping": linear.tangential_damping / math.sqrt(2.0 * linear.stiffness * mass),
        "attraction": values.peak_attraction / (stress_pa * diameter_m**2),
        "contact adhesion": values.contact_adhesion / linear.stiffness,
        "rest overlap": values.rest_overlap / diameter_m,
        "reach": values.reach / diameter_m,
        "static friction": values.static_friction,
        "sliding friction": values.sliding_friction,
        "rolling friction": values.rolling_friction,
    }
