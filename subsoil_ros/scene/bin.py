"""The box that the soil lies in."""

from typing import Literal

from pydantic import Field

from ..strict_model import Positive, StrictModel


class Bin(StrictModel):
    """Open box: x in [0, length], y in [-width/2, width/2]; particles only, tools may cross it.

    z = 0 is the mean top of the prepared bed; the floor follows from the bed. Periodic sides: what leaves at
    y = width/2 comes in at -width/2, as if the bin were a slice of an endless one; tools keep off them, or go
    through both. Held: the outermost soil stays where it is, a diameter of the largest particles thick.
    With soil.window, the bin is the whole field, of which soil exists near the tools only.
    """

    length_m: Positive = Field(description="along x, the direction of travel.")
    width_m: Positive = Field(description="along y.")
    depth_m: Positive = Field(description="of the bed.")
    sides: Literal["walls", "periodic", "held"] = Field(
        "walls", description="at y = +-width/2; held: only with soil.window."
    )

    @property
    def bed_sides(self) -> Literal["walls", "periodic"]:
        """Of the bed: held soil stands before walls."""
        return "walls" if self.sides == "held" else self.sides
