"""Bounds that the soil is checked against, so that a run with invalid physics stops without a result."""

from typing import Annotated

from pydantic import Field

from ..strict_model import Fraction, Positive, StrictModel


class Monitors(StrictModel):
    """Bounds that the soil is checked against every so many steps; null switches a bound off."""

    every_steps: Annotated[int, Field(ge=1)] = Field(100, description="soil steps between two checks.")
    max_velocity_reversal: Fraction | None = Field(
        0.2, description="1: every velocity reverses sign from one step to the next; the step is too large."
    )
    max_pair_overlap_radii: Positive | None = Field(
        1.9, description="of two particles; at tools: soil.max_tool_overlap_m."
    )
    max_energy_defect: Positive | None = Field(
        None,
        description="of the energy book, over the energy exchanged; left out: no book.",
    )
