"""Terrain: soil as a height field that tools dig."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..strict_model import NonNegative, Positive, StrictModel, WithinReach
from .soil import Bin
from .wedge_soil import FrictionAngle


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
        return self


class TerrainSoil(StrictModel):
    """Soil as a height field, for digging in real time (docs/terrain.md)."""

    model: Literal["terrain"]
    bin: Bin = Field(description="soil lies in it, level at z = 0 at first.")
    cell_m: Positive = Field(
        0.02, description="of the height field: a fifth of the smallest width of a tool."
    )
    values: TerrainValues

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells along x and y."""
        return max(1, round(self.bin.length_m / self.cell_m)), max(1, round(self.bin.width_m / self.cell_m))
