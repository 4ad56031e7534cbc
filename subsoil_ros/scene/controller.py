"""A controller: commands the speed of one driver while the machine runs."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..strict_model import Finite, Positive, StrictModel


class DraftLimit(StrictModel):
    """Speeds up to the highest speed while the draft is below its limit, slows down above it.

    acceleration = gain (limit - draft), within the limits of the controller.
    """

    kind: Literal["draft_limit"]
    draft_limit_newton: Positive = Field(description="needs mechanism.draft_driver.")
    gain_per_kg: Positive = Field(description="m/s2 per newton.")


class External(StrictModel):
    """A node of your own, named `controller`, sends a command for every control tick; the run waits."""

    kind: Literal["external"]


ControlLaw = Annotated[DraftLimit | External, Field(discriminator="kind")]


class Controller(StrictModel):
    """A speed for `driver` every `interval_ticks` ticks; it is reached at the end of that interval.

    The driver starts at the speed of its own law, a constant, and keeps it until the first command.
    """

    driver: str = Field(description="joint of kind driver; its own speed must be constant.")
    interval_ticks: int = Field(ge=1, description="between two commands; a multiple of record.series_ticks.")
    lowest_speed: Finite = Field(description="m/s, or rad/s of an angle's driver.")
    highest_speed: Finite = Field(description="m/s, or rad/s of an angle's driver.")
    max_acceleration: Positive = Field(
        description="m/s2, or rad/s2 of an angle's driver; a command that needs more ends the run."
    )
    law: ControlLaw

    @model_validator(mode="after")
    def _ordered(self) -> "Controller":
        if self.highest_speed <= self.lowest_speed:
            raise ValueError(
                f"highest_speed {self.highest_speed} must be larger than lowest_speed {self.lowest_speed}"
            )
        return self
