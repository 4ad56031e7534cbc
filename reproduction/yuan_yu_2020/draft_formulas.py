"""Draft of a subsoiler's share by McKyes and Ali (1977): the wedge of wedge/failure_wedge.py.

c and phi are those of the bed's own shear tests; nothing is fitted to it. ASABE D497.7: validation/blades.py.
"""

import math
from typing import NamedTuple

from subsoil_ros.wedge.failure_wedge import Plate, Strength, least_wedge


class ShearStrength(NamedTuple):
    """What shear tests of a bed gave."""

    cohesion_pa: float
    friction_rad: float
    density_kg_per_m3: float
    source: str


PAPER_GRID = (
    ShearStrength(37.9e3, math.radians(23.1), 1296.0, "grid, peak"),
    ShearStrength(21.6e3, math.radians(39.8), 1296.0, "grid, residual"),
)
"""Of the paper's soil on its grid (reproduction/yuan_yu_2020/soil_tests.md)."""

TOOL_FRICTION_RAD = math.atan(0.5)
"""Table 3: particle on boundary, 0.5."""


def mckyes_newton(
    depth_m: float,
    speed_m_per_s: float,
    strength: ShearStrength,
    width_m: float,
    rake_rad: float,
    gravity_m_per_s2: float = 9.81,
) -> float:
    """Horizontal force [N] on a plate from its tip to the surface, without adhesion (McKyes and Ali 1977).

    Tool friction is at most the soil's own.
    """
    delta = min(TOOL_FRICTION_RAD, strength.friction_rad)
    soil = Strength(
        unit_weight=strength.density_kg_per_m3 * gravity_m_per_s2,
        density=strength.density_kg_per_m3,
        cohesion=strength.cohesion_pa,
        friction=strength.friction_rad,
        adhesion=0.0,
        tool_friction=delta,
        surcharge=0.0,
        speed_factor=1.0,
    )
    plate = Plate(width_m, rake_rad, depth_m, depth_m)
    _, force = least_wedge(plate, soil, speed_m_per_s)
    return float(force * math.sin(rake_rad + delta))
