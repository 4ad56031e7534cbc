"""Closed forms of the pressure that a plate bears on soil.

A. S. Vesic, J. Soil Mech. Found. Div. ASCE 99 (1973) 45-73, without depth factors; G. G. Meyerhof, Canadian
Geotechnical Journal 1 (1963) 16-26. N_q, N_c and N_gamma are the factors of overburden, cohesion and weight.
"""

import math
from collections.abc import Callable

from ..blades import GRAVITY_M_PER_S2, Soil


def sand(friction_deg: float, density: float) -> Soil:
    """Soil without cohesion."""
    return Soil(0.0, math.radians(friction_deg), density)


def _factors(soil: Soil) -> tuple[float, float, float]:
    """N_q, N_c, and tan(45 deg + phi / 2)."""
    tangent, half = math.tan(soil.friction_rad), math.tan(0.25 * math.pi + 0.5 * soil.friction_rad)
    n_q = math.exp(math.pi * tangent) * half**2
    return n_q, (n_q - 1.0) / tangent, half


def vesic_pa(soil: Soil, depth_m: float, width_m: float, over_length: float) -> float:
    """Pressure on a plate [Pa]; over_length: its width over its length. The soil has friction."""
    tangent, (n_q, n_c, _) = math.tan(soil.friction_rad), _factors(soil)
    n_gamma = 2.0 * (n_q + 1.0) * tangent
    cohesion = soil.cohesion_pa * n_c * (1.0 + over_length * n_q / n_c)
    buried = depth_m * n_q * (1.0 + over_length * tangent)
    below = 0.5 * width_m * n_gamma * (1.0 - 0.4 * over_length)
    return cohesion + soil.density_kg_per_m3 * GRAVITY_M_PER_S2 * (buried + below)


def meyerhof_pa(soil: Soil, depth_m: float, width_m: float, over_length: float) -> float:
    """As vesic_pa, by Meyerhof's factors of shape and depth."""
    n_q, n_c, half = _factors(soil)
    n_gamma = (n_q - 1.0) * math.tan(1.4 * soil.friction_rad)
    shape, deep = 0.1 * half**2 * over_length, 0.1 * half * depth_m / width_m
    cohesion = soil.cohesion_pa * n_c * (1.0 + 2.0 * shape) * (1.0 + 2.0 * deep)
    weight = soil.density_kg_per_m3 * GRAVITY_M_PER_S2 * (depth_m * n_q + 0.5 * width_m * n_gamma)
    return cohesion + weight * (1.0 + shape) * (1.0 + deep)


FORMS: dict[str, Callable[[Soil, float, float, float], float]] = {
    "Vesic": vesic_pa,
    "Meyerhof": meyerhof_pa,
}
