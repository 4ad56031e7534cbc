"""Cement between the particles of a soil."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from ..strict_model import Fraction, NonNegative, Positive, StrictModel


class Bonds(StrictModel):
    """Elastic beams between neighbours, made once where soil is laid out; one that breaks is gone for good.

    They act beside the contact law (D.O. Potyondy, P.A. Cundall, Int. J. Rock Mech. Min. Sci. 41 (2004)
    1329-1364). Moduli and strengths are those of the cement, so they hold for particles of every size.
    """

    youngs_modulus_pa: Positive = Field(
        description="normal stiffness of a bond: modulus over its length, times its section."
    )
    stiffness_ratio: Positive = Field(2.5, description="normal over shear stiffness.")
    tensile_strength_pa: Positive = Field(description="normal stress at which a bond breaks.")
    cohesion_pa: Positive = Field(description="shear strength without normal stress.")
    friction_angle_deg: Annotated[float, Field(ge=0.0, lt=90.0)] = Field(
        0.0, description="growth of the shear strength with pressure."
    )
    radius_over_particle: Fraction = Field(1.0, description="of a bond, over that of the smaller particle.")
    gap_over_radius: NonNegative = Field(
        0.05, description="neighbours farther apart, over the smaller radius, are not bonded."
    )
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        0.1,
        description="part of critical damping of two equal particles; of turns, times radius_over_particle.",
    )

    @model_validator(mode="after")
    def _tension_within_the_line_of_coulomb(self) -> "Bonds":
        slope = math.tan(math.radians(self.friction_angle_deg))
        if self.tensile_strength_pa * slope > self.cohesion_pa:
            raise ValueError(
                f"tensile_strength_pa: given {self.tensile_strength_pa:g} Pa, allowed is up to cohesion_pa / "
                f"tan(friction_angle_deg) = {self.cohesion_pa / slope:.4g} Pa, where the shear strength ends"
            )
        return self

    @property
    def longest(self) -> float:
        """Distance of two bonded particles at most, over the radius of equal ones."""
        return (2.0 + self.gap_over_radius) * (1.0 + self.tensile_strength_pa / self.youngs_modulus_pa)
