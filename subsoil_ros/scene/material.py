"""A soil as a laboratory describes it, and the particles that were calibrated to it."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..strict_model import NonNegative, Positive, StrictModel
from ..yaml_document import Document
from .sizes import UniformSizes, mean_power

VERSION = 1
"""Version of the format of material files."""

RADIUS_SPREAD = 0.15
"""Half of the range of radii over their mean: unequal spheres do not crystallise."""

SIMILAR = 2.0
"""A material is accepted at radii from 1 / SIMILAR to SIMILAR times the calibrated one: by similarity it
stays the same soil, but a tool's forces depend on the size of its particles. Source: C.J. Coetzee,
Powder Technol. 310 (2017) 104-142."""


class LaboratorySoil(StrictModel):
    """What `subsoil calibrate` fits particles to."""

    model: Literal["laboratory"]
    name: str = Field(min_length=1)
    source: str = Field(min_length=1)  # of the numbers
    cohesion_pa: NonNegative
    friction_angle_deg: Annotated[float, Field(gt=0.0, lt=60.0)]
    bulk_density_kg_per_m3: Positive  # moist
    metal_friction_angle_deg: Annotated[float, Field(ge=0.0, lt=60.0)]  # delta, of soil on a tool
    solid_fraction: float = Field(0.60, ge=0.55, le=0.64)  # of the bed of spheres: dense ones dilate
    critical_friction_angle_deg: Annotated[float, Field(gt=0.0, lt=60.0)] | None = None  # of a dry soil
    confined_modulus_pa: Positive | None = None  # secant from 10 to 100 kPa; None: overlaps at work decide
    tensile_strength_pa: NonNegative | None = None  # compared, not fitted
    water_content: NonNegative | None = None  # mass of water over that of dry soil; not used

    @model_validator(mode="after")
    def _critical_of_dry_soil(self) -> "LaboratorySoil":
        critical = self.critical_friction_angle_deg
        if critical is None:
            return self
        if self.cohesion_pa > 0.0:
            raise ValueError(
                f"critical_friction_angle_deg: given {critical:g} with cohesion_pa {self.cohesion_pa:g}; it "
                "is fitted without cohesion only: leave it out, or give cohesion_pa 0"
            )
        if critical > self.friction_angle_deg:
            raise ValueError(
                f"critical_friction_angle_deg: given {critical:g}; it must be at most friction_angle_deg, "
                f"{self.friction_angle_deg:g}, the angle at the peak"
            )
        return self

    @model_validator(mode="after")
    def _bounded_tension(self) -> "LaboratorySoil":
        largest = self.cohesion_pa / math.tan(math.radians(self.friction_angle_deg))
        if (self.tensile_strength_pa or 0.0) > largest:
            raise ValueError(
                f"tensile_strength_pa: {self.tensile_strength_pa:g} Pa contradicts the strength: no soil "
                f"bears more tension than cohesion_pa / tan(friction_angle_deg), {largest:.4g} Pa"
            )
        return self


class Interval(StrictModel):
    """A number and the ends of its 95 % confidence interval."""

    value: float
    low: float
    high: float


class Material(StrictModel):
    """Particles that make a soil, as `subsoil calibrate` writes them and `soil.material` names them."""

    version: int
    soil: LaboratorySoil
    radius_m: Positive  # mean radius that the law was calibrated at
    density_kg_per_m3: Positive  # of a particle
    law: Document
    bonds: Document | None = None
    fitted: dict[str, Interval]  # by key of the law's rows
    measured: dict[str, Interval]  # what the particles make, by key of `soil`

    @property
    def radii_m(self) -> tuple[float, float]:
        """Least and largest mean radius at which the material is accepted."""
        return self.radius_m / SIMILAR, self.radius_m * SIMILAR

    def section(self, radius_m: float) -> Document:
        """Keys of a scene's soil, without its bin, for particles of this mean radius."""
        bonds = {} if self.bonds is None else {"bonds": self.bonds}
        return bonds | {
            "particles": {
                "sizes": sizes_about(radius_m),
                "density_kg_per_m3": self.density_kg_per_m3,
                "reference_radius_m": mean_volume_radius_m(self.radius_m),
            },
            "bed": {"kind": "tiled", "solid_fraction": self.soil.solid_fraction},
            "law": self.law,
        }


def sizes_about(radius_m: float) -> Document:
    """Radii within RADIUS_SPREAD of a mean."""
    return {
        "kind": "uniform",
        "min_radius_m": (1.0 - RADIUS_SPREAD) * radius_m,
        "max_radius_m": (1.0 + RADIUS_SPREAD) * radius_m,
    }


def mean_volume_radius_m(radius_m: float) -> float:
    """Radius of the sphere of mean volume among radii about this mean."""
    return mean_power(UniformSizes.model_validate(sizes_about(radius_m)), 3) ** (1.0 / 3.0)
