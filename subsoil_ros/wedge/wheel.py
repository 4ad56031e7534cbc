"""A rigid wheel on soil: load from pressure and sinkage, resistance from compaction, grip from shear.

Sources: M.G. Bekker, Introduction to Terrain-Vehicle Systems (1969); J.Y. Wong, Theory of Ground Vehicles
(2001), chapter 2; Z. Janosi, B. Hanamoto, Proc. 1st Int. Conf. Mechanics of Soil-Vehicle Systems (1961).
"""

import math

from ..scene.tool_faces import WheelFace
from ..scene.wedge_soil import WedgeValues, WheelSoil

SLOWEST_M_PER_S = 1e-3
"""Speed below which resistance and slip go to zero with it, so that no force pushes a standing wheel."""


def wheel_load_newton(wheel: WheelFace, soil: WheelSoil, sinkage_m: float) -> float:
    """W = b k sqrt(D) z^(n + 1/2) (3 - n) / 3, with k = k_c / b + k_phi (Bekker; Wong eq. 2.78).

    It follows from the pressure p = k z^n on the front of the rim, whose arc is taken as a parabola.
    """
    n = soil.exponent
    k = soil.cohesive_modulus / wheel.width_m + soil.frictional_modulus
    return wheel.width_m * k * math.sqrt(2.0 * wheel.radius_m) * sinkage_m ** (n + 0.5) * (3.0 - n) / 3.0


def rolling_resistance_newton(wheel: WheelFace, soil: WheelSoil, sinkage_m: float) -> float:
    """R = (1 - recovered) b k z^(n + 1) / (n + 1): compaction per length (Bekker; Wong eq. 2.76)."""
    n = soil.exponent
    k = soil.cohesive_modulus / wheel.width_m + soil.frictional_modulus
    return (1.0 - soil.recovered_fraction) * wheel.width_m * k * sinkage_m ** (n + 1.0) / (n + 1.0)


def grip_newton(
    wheel: WheelFace, values: WedgeValues, load_newton: float, sinkage_m: float, slip: float
) -> float:
    """Shear force at the tread, (b L c + W tan phi) (1 - (1 - e^-x) / x), x = slip L / K (Wong eq. 2.86).

    L = sqrt(D z) is the length in contact. `slip` is without sign.
    """
    assert values.wheels is not None
    length = math.sqrt(2.0 * wheel.radius_m * sinkage_m)
    x = slip * length / values.wheels.shear_deformation_m
    mobilised = 0.5 * x if x < 1e-6 else 1.0 - (1.0 - math.exp(-x)) / x
    strength = wheel.width_m * length * values.cohesion_pa
    return (strength + load_newton * math.tan(values.friction_angle_rad)) * mobilised
