"""Wedge model of the soil: passive failure in front of tools, pressure and sinkage under wheels."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..strict_model import NonNegative, Positive, StrictModel, WithinReach
from .soil import Bin

LARGEST_FRICTION_ANGLE_RAD = math.radians(55.0)
"""Largest friction angle: no soil has more, and beyond it the wedge of a raked blade has no solution."""

LARGEST_SUM_RAD = math.radians(170.0)
"""Largest sum of rake, friction and tool friction: the wedge's force tends to infinity as these and beta add
up to 180 degrees."""


FrictionAngle = Annotated[
    float, Field(ge=0.0, le=LARGEST_FRICTION_ANGLE_RAD, allow_inf_nan=False), WithinReach
]
Part01 = Annotated[float, Field(ge=0.0, lt=1.0), WithinReach]


class WheelSoil(StrictModel):
    """Pressure under a wheel, p = (k_c / b + k_phi) z^n (Bekker), and shear along it (Janosi, Hanamoto)."""

    cohesive_modulus: NonNegative = Field(description="k_c [N/m^(n+1)].")
    frictional_modulus: NonNegative = Field(description="k_phi [N/m^(n+2)].")
    exponent: Annotated[float, Field(gt=0.0, lt=3.0), WithinReach] = Field(description="n.")
    recovered_fraction: Part01 = Field(
        0.0, description="of the work of compaction, given back behind the wheel."
    )
    shear_deformation_m: Positive = Field(0.01, description="K, of the shear under the wheel.")
    damping_newton_s_per_m: NonNegative = 0.0

    @model_validator(mode="after")
    def _bears(self) -> "WheelSoil":
        if self.cohesive_modulus + self.frictional_modulus <= 0.0:
            raise ValueError("frictional_modulus: both moduli are 0, so nothing bears a wheel; give one")
        return self


class WedgeValues(StrictModel):
    """Strength of the soil and how it fails (docs/wedge.md)."""

    theory: Literal["mckyes_ali", "perumpral"] = Field(
        "mckyes_ali",
        description="perumpral: the wedge's sides resist, shanks part broken soil; mckyes_ali: crescents.",
    )
    density_kg_per_m3: Positive
    cohesion_pa: NonNegative = Field(description="c, of the soil.")
    friction_angle_rad: FrictionAngle = Field(description="phi, of the soil.")
    adhesion_pa: NonNegative = Field(description="c_a, of soil on tool; at most the cohesion.")
    tool_friction_angle_rad: FrictionAngle = Field(description="delta; at most friction_angle_rad.")
    surcharge_pa: NonNegative = Field(0.0, description="on the surface.")
    speed_factor: NonNegative = Field(
        1.0, description="on the inertia of the soil that gives way; 1: as the theory has it."
    )
    bed_modulus_newton_per_m3: Positive = Field(
        2.0e7, description="pressure over displacement while a wedge forms."
    )
    failure: Literal["sudden", "gradual"] = Field(
        "sudden",
        description="sudden: force is lost at once and rises with travel; gradual: it falls as it rises.",
    )
    drop: Part01 = Field(0.3, description="part of its force that a wedge, or a block of it, loses.")
    block_depth_m: Annotated[float, Field(ge=0.01), WithinReach] | None = Field(
        None,
        description="depth up to which a wedge is one block; deeper: (depth / this)^2. Left out: always one.",
    )
    tip_m: NonNegative = Field(
        0.0,
        description="height of the share's blunt tip, which soil lifts as much as it holds it back.",
    )
    period_factor: Positive = Field(
        0.3, description="travel from failure to failure over the length of the wedge."
    )
    period_m: Positive | None = Field(
        None, description="the travel itself, where it does not follow the wedge (a regular bed)."
    )
    variation: Part01 = Field(
        0.1, description="standard deviation of strength and length from wedge to wedge, relative."
    )
    length_variation: NonNegative | None = Field(
        None, description="that of the length, where it is another: lognormal, so it may be above 1."
    )
    rate_s_per_m: NonNegative = Field(
        0.0, description="relative rise of what blocks bear for each m/s of the plate along its normal."
    )
    shank_fraction: NonNegative = Field(
        1.0, description="of a lone shank's resistance, met in soil that the share has broken."
    )
    wheels: WheelSoil | None = Field(None, description="for tools of role wheel.")

    @model_validator(mode="after")
    def _strong(self) -> "WedgeValues":
        if self.tool_friction_angle_rad > self.friction_angle_rad:
            raise ValueError(
                f"tool_friction_angle_rad: {self.tool_friction_angle_rad:g} is above friction_angle_rad "
                f"{self.friction_angle_rad:g}; soil then fails in itself: give at most that"
            )
        if self.adhesion_pa > self.cohesion_pa:
            raise ValueError(
                f"adhesion_pa: {self.adhesion_pa:g} is above cohesion_pa {self.cohesion_pa:g}; soil then "
                "fails in itself: give at most that"
            )
        return self


class WedgeSoil(StrictModel):
    """Soil without particles (docs/wedge.md): `values`, or a `file` of `subsoil calibrate`."""

    model: Literal["wedge"]
    bin: Bin = Field(description="soil lies in 0 <= x <= length.")
    values: WedgeValues | None = None
    file: str | None = Field(None, description="relative to the scene file.")
    fitted_to: str | None = Field(
        None, description="scene whose particles the soil file must have been fitted to."
    )
    seed: int = Field(0, ge=0, description="of the variation from wedge to wedge.")

    @model_validator(mode="after")
    def _one_source(self) -> "WedgeSoil":
        if (self.values is None) == (self.file is None):
            given = "neither is given" if self.file is None else "both are given"
            raise ValueError(f"values: {given}; give 'values', or 'file' written by `subsoil calibrate`")
        if self.file is None and self.fitted_to is not None:
            raise ValueError("fitted_to: only a 'file' was fitted to anything; leave it out")
        return self


class ExternalSoil(StrictModel):
    """Soil of another program, which answers motions with wrenches (docs/own_machine.md)."""

    model: Literal["external"]
    bin: Bin = Field(description="where that soil lies: metrics and pictures refer to it.")


class SoilRange(StrictModel):
    """What the runs covered that a soil file was fitted to."""

    depth_m: tuple[Positive, Positive]
    speed_m_per_s: tuple[Positive, Positive]
    rake_rad: tuple[Positive, Positive]
