"""Graded beds: small particles in a core along the path of the tools, larger ones away from it."""

import math

import numpy as np
from pydantic import Field

from ..strict_model import Positive, StrictModel

LARGEST_STEP = 1.5
"""Largest ratio of the radii of neighbouring sizes. Three spheres that touch let one pass whose radius is
2 / sqrt(3) - 1 = 0.155 of theirs, so no particle falls through the gaps of the next size."""

SHELL_DIAMETERS = 4.0
"""Thickness of a size between core and coarsest over its mean diameter: thick enough that in its middle its
own particles, not those of its neighbours, carry the stress."""


class Coarse(StrictModel):
    """Larger particles beyond the core. Sizes between the two grow by at most a factor of 1.5 from one to
    the next; every size has the law of the soil, scaled to its radius."""

    times: float = Field(gt=1.0, allow_inf_nan=False, description="largest radii over those of the core.")
    beyond_m: Positive | None = Field(
        None,
        description="half width of the core; default: half the tillage tools and half their depth.",
    )
    below_m: Positive | None = Field(
        None, description="depth of the core; default: the tools' depth and two coarse diameters."
    )

    @property
    def factors(self) -> tuple[float, ...]:
        """Radii of each size over those of the core, from the core outwards."""
        steps = max(1, math.ceil(math.log(self.times) / math.log(LARGEST_STEP) - 1e-9))
        return tuple(self.times ** (k / steps) for k in range(steps + 1))

    def ends_m(self, radius_m: float) -> np.ndarray:
        """Distance from the core at which each size but the last ends; `radius_m`: the mean of the core."""
        return SHELL_DIAMETERS * 2.0 * radius_m * np.cumsum((0.0, *self.factors[1:-1]))

    def distance_m(self, y_m: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
        """(n,) [m] from the core, the larger of that aside and that down; negative inside."""
        assert self.beyond_m is not None
        assert self.below_m is not None
        return np.maximum(np.abs(y_m) - self.beyond_m, depth_m - self.below_m)
