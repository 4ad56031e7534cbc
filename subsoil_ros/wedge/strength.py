"""Strength of the soil of a wedge model, as its kernels take it."""

from ..scene.wedge_soil import WedgeValues
from .wedge import Strength


def strength_of(values: WedgeValues, gravity: float) -> Strength:
    """Strength of soil with these values; gravity [m/s2]."""
    return Strength(
        values.density_kg_per_m3 * gravity, values.density_kg_per_m3, values.cohesion_pa,
        values.friction_angle_rad, values.adhesion_pa, values.tool_friction_angle_rad, values.surcharge_pa,
        values.speed_factor, values.theory == "perumpral",
    )  # fmt: skip
