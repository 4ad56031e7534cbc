"""Terrain: soil as a height field that tools dig."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..strict_model import NonNegative, Positive, StrictModel, WithinReach
from .soil import Bin
from .wedge_soil import LARGEST_SUM_RAD, FrictionAngle

MOST_CELLS = 20_000_000
"""Largest number of cells: they take 0.5 GB."""


class TerrainValues(StrictModel):
    """Strength of the soil (docs/terrain.md)."""

    density_kg_per_m3: Positive = Field(description="of firm soil.")
    cohesion_pa: NonNegative = Field(description="c, of firm soil.")
    friction_angle_rad: FrictionAngle = Field(description="phi, of firm soil.")
    loose_cohesion_pa: NonNegative = Field(0.0, description="of soil that was cut; at most cohesion_pa.")
    loose_friction_angle_rad: FrictionAngle = Field(
        description="of soil that was cut, the slope at which it rests; at most friction_angle_rad."
    )
    adhesion_pa: NonNegative = Field(description="c_a, of soil on tool; at most the cohesion.")
    tool_friction_angle_rad: FrictionAngle = Field(description="delta; at most friction_angle_rad.")
    loosening: Annotated[float, Field(ge=0.0, le=1.0), WithinReach] = Field(
        0.1, description="volume that soil gains when it is cut, relative."
    )
    speed_factor: NonNegative = Field(1.0, description="on the inertia of the soil that gives way.")
    bed_modulus_newton_per_m3: Positive = Field(
        2.0e7, description="pressure over displacement until the soil gives way."
    )

    @model_validator(mode="after")
    def _weaker_tool(self) -> "TerrainValues":
        for tool, soil in (
            ("tool_friction_angle_rad", "friction_angle_rad"),
            ("loose_friction_angle_rad", "friction_angle_rad"),
            ("adhesion_pa", "cohesion_pa"),
            ("loose_cohesion_pa", "cohesion_pa"),
        ):
            if getattr(self, tool) > getattr(self, soil):
                raise ValueError(
                    f"{tool}: {getattr(self, tool):g} is above {soil} {getattr(self, soil):g}; give at most "
                    "that"
                )
        friction = 0.5 * (self.friction_angle_rad + self.loose_friction_angle_rad)
        most = LARGEST_SUM_RAD - 0.5 * math.pi - friction
        if self.tool_friction_angle_rad > most:
            raise ValueError(
                f"tool_friction_angle_rad: given {self.tool_friction_angle_rad:g}; at a mean friction angle "
                f"of {friction:.3g} rad the wedge before an upright plate takes {most:.3g} at most"
            )
        return self


class TerrainSoil(StrictModel):
    """Soil as a height field, for digging in real time (docs/terrain.md)."""

    model: Literal["terrain"]
    bin: Bin = Field(description="soil lies in it, level at z = 0 at first.")
    cell_m: Positive = Field(
        0.02, description="of the height field: a tenth of the width of a tool, or less."
    )
    values: TerrainValues

    @model_validator(mode="after")
    def _cells_fit(self) -> "TerrainSoil":
        if self.bin.sides != "walls":
            raise ValueError(
                f"bin.sides: given '{self.bin.sides}', which only particles have; a terrain ends at 'walls'"
            )
        most = 0.25 * min(self.bin.length_m, self.bin.width_m)
        if self.cell_m > most:
            raise ValueError(
                f"cell_m: given {self.cell_m:g}; a terrain of {self.bin.length_m:g} x {self.bin.width_m:g} m "
                f"takes {most:g} at most, four cells along its shorter side"
            )
        rows, columns = self.shape
        if rows * columns > MOST_CELLS:
            raise ValueError(
                f"cell_m: given {self.cell_m:g}, which makes {rows * columns:,} cells; at most "
                f"{MOST_CELLS:,} are allowed: give larger cells or a smaller bin"
            )
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells along x and y."""
        return max(1, round(self.bin.length_m / self.cell_m)), max(1, round(self.bin.width_m / self.cell_m))
