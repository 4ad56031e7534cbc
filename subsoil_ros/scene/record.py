"""What is recorded: `record` in a scene."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from ..strict_model import Finite, NonNegative, StrictModel

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


class Record(StrictModel):
    """What goes into the bag, and how often. The bag always has all lockstep messages."""

    bag: bool = Field(True, description="false: no recorder, bag or series; summary and checkpoints remain.")
    series_ticks: int = Field(20, ge=1, description="series, poses, wrenches, /tf every so many ticks.")
    cloud_hz: NonNegative = Field(10.0, description="soil clouds per simulated second; 0: none.")
    cloud_region: CloudRegion | None = Field(
        None, description="particles with their centre outside of it are left out."
    )
    cloud_resolution_m: Annotated[float, Field(ge=0.0, le=0.1)] = Field(
        0.0, description="positions are rounded to it; 0: not."
    )
    checkpoint_s: NonNegative | None = Field(
        None,
        description="simulated seconds between checkpoints; 0: none but on SIGTERM or SIGINT; left out: 0.5 "
        "with particles, 10 without.",
    )


def position_step_m(resolution_m: float) -> float:
    """Step of rounded positions [m], the largest power of two up to the resolution: low bits are then zero.

    A resolution below a nanometre counts as a nanometre.
    """
    return 2.0 ** math.floor(math.log2(max(resolution_m, 1e-9)))
