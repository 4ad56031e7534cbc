"""Bounds that a running soil is held against, so that lost physics stops a run and is no result."""

from typing import Annotated

from pydantic import Field

from ..strict_model import Fraction, Positive, StrictModel


class Monitors(StrictModel):
    """Looks at the soil every so many steps; null switches a bound off. dem.monitors says what each means."""

    every_steps: Annotated[int, Field(ge=1)] = Field(100, description="soil steps from look to look.")
    max_velocity_reversal: Fraction | None = 0.2
    max_pair_overlap_radii: Positive | None = Field(1.9, description="at tools: soil.max_tool_overlap_m.")
    max_energy_defect: Positive | None = Field(
        None, description="over the energy exchanged; books every sink."
    )
