"""Strength of layered soil, as one plate meets it."""

import math
from collections.abc import Sequence

from ..scene.wedge import WedgeValues
from .wedge import Strength

Layers = Sequence[tuple[float, WedgeValues]]
"""(depth of the lower edge [m], values) from the top; the last edge is at infinite depth."""


def mean_strength(layers: Layers, depth_m: float, height_m: float, gravity: float) -> Strength:
    """Mean strength of the soil at a plate of height `height_m` above its tip at `depth_m`.

    The rupture surface is plane, so equal heights have equal parts of it: cohesion and tan(phi) are means
    over the depth. The wedge widens upward with the height above the tip, so the unit weight is
    weighted by that. Adhesion and friction of the tool are means over the plate.
    """
    first = layers[0][1]
    if len(layers) == 1:
        return Strength(
            first.density_kg_per_m3 * gravity, first.density_kg_per_m3, first.cohesion_pa,
            first.friction_angle_rad, first.adhesion_pa, first.tool_friction_angle_rad, first.surcharge_pa,
            first.speed_factor, first.theory == "perumpral",
        )  # fmt: skip
    density = cohesion = friction = adhesion = tool_friction = 0.0
    top, plate_top = 0.0, depth_m - height_m
    for edge, values in layers:
        bottom = min(edge, depth_m)
        part = (bottom - top) / depth_m
        middle = 0.5 * (bottom + top)
        density += values.density_kg_per_m3 * part * 2.0 * (1.0 - middle / depth_m)
        cohesion += values.cohesion_pa * part
        friction += math.tan(values.friction_angle_rad) * part
        on_plate = max(bottom - max(top, plate_top), 0.0) / height_m
        adhesion += values.adhesion_pa * on_plate
        tool_friction += math.tan(values.tool_friction_angle_rad) * on_plate
        top = bottom
        if bottom >= depth_m:
            break
    return Strength(
        density * gravity, density, cohesion, math.atan(friction), adhesion, math.atan(tool_friction),
        first.surcharge_pa, first.speed_factor, first.theory == "perumpral",
    )  # fmt: skip
