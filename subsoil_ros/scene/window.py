"""The soil that exists of a field: so much ahead of the tools and behind them."""

import math

from pydantic import Field

from ..strict_model import Positive, StrictModel


class SoilWindow(StrictModel):
    """Soil exists from `behind_m` behind the rearmost to `ahead_m` ahead of the foremost point of all tools.

    It is laid out and taken away in strips while the tools drive. A soil.material gives both: the rupture
    distance of a cut as deep as the bed.
    """

    ahead_m: Positive = Field(description="at least the depth of the bed.")
    behind_m: Positive = Field(description="at least the depth of the bed.")


def rupture_distance_m(depth_m: float, friction_angle_deg: float) -> float:
    """How far ahead of an upright cut the soil fails at the surface: Rankine's passive wedge."""
    return depth_m * math.tan(math.radians(45.0 + 0.5 * friction_angle_deg))
