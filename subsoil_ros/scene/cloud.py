"""Region and resolution of the recorded clouds."""

import math

from pydantic import model_validator

from ..strict_model import Finite, StrictModel

SPEED_BITS = 8
"""Significant bits of the speeds of a rounded cloud: to 0.2 %, finer than the colours of a picture show."""

Span = tuple[Finite, Finite]


class CloudRegion(StrictModel):
    """An axis-aligned box in world axes; a direction that is not given is not bounded."""

    x_m: Span | None = None
    y_m: Span | None = None
    z_m: Span | None = None

    @property
    def spans_m(self) -> tuple[Span | None, ...]:
        """Bounds along x, y and z."""
        return self.x_m, self.y_m, self.z_m

    @model_validator(mode="after")
    def _bounded(self) -> "CloudRegion":
        if self.spans_m == (None, None, None):
            raise ValueError("gives no bounds; give x_m, y_m or z_m as [from, to], or leave cloud_region out")
        for axis, span in zip("xyz", self.spans_m, strict=True):
            if span is not None and span[0] >= span[1]:
                raise ValueError(
                    f"{axis}_m: given [{span[0]:g}, {span[1]:g}]; it must be [from, to], from < to"
                )
        return self


def position_step_m(resolution_m: float) -> float:
    """Step of rounded positions [m], the largest power of two up to the resolution: low bits are then zero.

    A resolution below a nanometre counts as a nanometre.
    """
    return 2.0 ** math.floor(math.log2(max(resolution_m, 1e-9)))
