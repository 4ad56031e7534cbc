"""Spheres that yield and stick: the Edinburgh elasto-plastic adhesive law (EEPA).

S.C. Thakur, J.P. Morrissey, J. Sun, J.F. Chen, J.Y. Ooi, Granular Matter 16 (2014) 383-400. With an exponent
of 1 and no adhesion it is the hysteretic spring of O.R. Walton, R.L. Braun, J. Rheol. 30 (1986) 949-980.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, field_validator, model_validator

from ...strict_model import Fraction, NonNegative, PoissonRatio, Positive, StrictModel
from ..base import ContactLaw, PairValues, with_weaker_friction
from ..dampers import damping_ratio_at
from ..hertz.law import RAYLEIGH_FRACTION, rayleigh_time_s, reduced_compliances, springs_at

TANGENTIAL_RATIO = 2.0 / 7.0
"""Tangential over loading stiffness, exponent 1: a sticking contact then swings as fast along the tangent as
along the normal (Thakur et al. 2014)."""

EXPONENTS = (1.0, 1.5)
"""Linear springs, and those of elastic spheres (Thakur et al. 2014)."""


class ElastoPlasticAdhesiveNumbers(NamedTuple):
    """Numbers of one kind of pair. SI; with exponent 3/2 stiffnesses are per root of overlap, dampings per
    fourth root."""

    unloading_stiffness: float  # k2
    tangential_stiffness: float
    damping: float
    tangential_damping: float
    plastic_part: float  # lambda_p^(1 / n): plastic over largest overlap
    adhesion_root: float  # 3/2 pi dgamma sqrt(2 R) [N/m^0.5]: largest attraction over root of plastic overlap
    pull_off: float  # [N]
    static_friction: float
    sliding_friction: float
    rolling_stiffness: float  # tangential one times R_eff^2
    rolling_arm: float  # mu_r R_eff [m]: torque limit over normal force
    hertzian: float  # 1: exponent 3/2, 0: exponent 1


@dataclass(frozen=True)
class ElastoPlasticAdhesivePair(PairValues):
    """Pair values with loading stiffness k1, and those of the law; units as ElastoPlasticAdhesiveNumbers."""

    exponent: float = 1.0
    contact_plasticity: float = 0.0  # lambda_p = 1 - k1 / k2
    adhesion_root: float = 0.0
    pull_off: float = 0.0

    @property
    def unloading_stiffness(self) -> float:
        """k2."""
        return self.stiffness / (1.0 - self.contact_plasticity)

    @property
    def sticks(self) -> bool:
        """Whether anything attracts."""
        return self.adhesion_root + self.pull_off > 0.0

    @property
    def max_stiffness(self) -> float:
        """That of unloading; it limits the step. No attraction is steeper."""
        return self.unloading_stiffness

    def loaded_m(self, force_newton: float) -> float:
        """Overlap at which a contact carries `force_newton` when it is first loaded [m]."""
        return float((force_newton / self.stiffness) ** (1.0 / self.exponent))

    def stiffened(self, factor: float) -> "ElastoPlasticAdhesivePair":
        """With both stiffnesses times `factor`; the restitution stays."""
        damper = math.sqrt(factor)
        return replace(
            self,
            stiffness=factor * self.stiffness,
            damping=damper * self.damping,
            tangential_damping=damper * self.tangential_damping,
        )

    def scaled(self, ratio: float) -> "ElastoPlasticAdhesivePair":
        """Stiffnesses follow from moduli and the size; a surface energy goes with the radius, a force with
        its square, so that the strength of a soil stays."""
        return replace(self, adhesion_root=ratio * self.adhesion_root, pull_off=ratio**2 * self.pull_off)

    def linear_at(self, overlap_m: float) -> PairValues:
        """Springs and dashpots of small motion at this overlap, which unloads and loads again, in N/m and
        N s/m."""
        root = math.sqrt(overlap_m) if self.exponent > 1.0 else 1.0
        return springs_at(self, self.exponent * self.unloading_stiffness * root, root)


class ElastoPlasticAdhesiveValues(StrictModel):
    """A material; all of the `boundary` row but its moduli stands for particle and boundary."""

    youngs_modulus_pa: Positive
    poisson_ratio: PoissonRatio
    contact_plasticity: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        description="lambda_p = 1 - k1 / k2, loading over unloading stiffness."
    )
    surface_energy_joule_per_m2: NonNegative = Field(
        0.0, description="dgamma: attraction 3/2 pi dgamma a over the contact's plastic radius a."
    )
    pull_off_newton: NonNegative = Field(0.0, description="-f0: attraction of any contact.")
    restitution: Fraction = Field(
        1.0, description="Of the dashpot alone, on the unloading spring; it never pulls."
    )
    static_friction: NonNegative
    sliding_friction: NonNegative
    rolling_friction: NonNegative = 0.0

    @model_validator(mode="after")
    def _something_sticks(self) -> "ElastoPlasticAdhesiveValues":
        if self.surface_energy_joule_per_m2 > 0.0 and self.contact_plasticity == 0.0:
            raise ValueError(
                f"surface_energy_joule_per_m2: given {self.surface_energy_joule_per_m2:g} with "
                "contact_plasticity 0, where no contact is left that sticks; give a contact_plasticity above "
                "0, or pull_off_newton"
            )
        return self


class ElastoPlasticAdhesiveLaw(ContactLaw):
    """Spheres that yield (load with k1, unload with k2 > k1) and stick (EEPA); the force goes with the
    overlap to the power `exponent`, 1 or 1.5. The normal force and what attracts besides limit friction.
    """

    kind: Literal["elasto_plastic_adhesive"]
    exponent: float = 1.0
    particle: ElastoPlasticAdhesiveValues
    boundary: ElastoPlasticAdhesiveValues

    @field_validator("exponent")
    @classmethod
    def _one_of_two(cls, given: float) -> float:
        if given not in EXPONENTS:
            raise ValueError(
                f"exponent: given {given:g}, allowed are 1 and 1.5; the force is of such springs"
            )
        return given

    numbers = ElastoPlasticAdhesiveNumbers
    more_sinks = ("yielding", "adhesion")
    kept = {"plastic_overlap_m": 1, "adhesive_ratio": 1}  # noqa: RUF012

    def pair(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """Two particles under this law."""
        return self._with(self.particle, self.particle, ratio, radius_m, mass_kg)

    def mixed_pair(
        self, other: "ElastoPlasticAdhesiveLaw", ratio: float, radius_m: float, mass_kg: float
    ) -> PairValues:
        """E* and G* of two materials; of the rest the weaker: the larger plasticity, the smaller attraction,
        friction and restitution."""
        one, two = self.particle, other.particle
        weaker = two.model_copy(
            update={
                "contact_plasticity": max(one.contact_plasticity, two.contact_plasticity),
                **{
                    key: min(getattr(one, key), getattr(two, key))
                    for key in (
                        "surface_energy_joule_per_m2",
                        "pull_off_newton",
                        "restitution",
                    )
                },
            }
        )
        return with_weaker_friction(self._with(one, weaker, ratio, radius_m, mass_kg), one, two)

    def at_boundary(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """A particle at a wall or tool."""
        return self._with(self.particle, self.boundary, ratio, radius_m, mass_kg)

    @classmethod
    def numbers_of(cls, values: PairValues, radius_m: float) -> ElastoPlasticAdhesiveNumbers:
        """Numbers of a pair."""
        assert isinstance(values, ElastoPlasticAdhesivePair)
        return ElastoPlasticAdhesiveNumbers(
            unloading_stiffness=values.unloading_stiffness,
            tangential_stiffness=values.tangential_stiffness,
            damping=values.damping,
            tangential_damping=values.tangential_damping,
            plastic_part=values.contact_plasticity ** (1.0 / values.exponent),
            adhesion_root=values.adhesion_root,
            pull_off=values.pull_off,
            static_friction=values.static_friction,
            sliding_friction=values.sliding_friction,
            rolling_stiffness=values.tangential_stiffness * radius_m**2,
            rolling_arm=values.rolling_friction * radius_m,
            hertzian=float(values.exponent > 1.0),
        )

    def wave_limit(self, radius_m: float, density_kg_per_m3: float) -> tuple[str, float] | None:
        """For exponent 3/2 part of the Rayleigh time at the unloading stiffness, the larger of both rows."""
        if self.exponent == 1.0:
            return None
        row = self.particle
        plastic = max(row.contact_plasticity, self.boundary.contact_plasticity)
        stiffer = row.youngs_modulus_pa / (1.0 - plastic)
        time = rayleigh_time_s(stiffer, row.poisson_ratio, radius_m, density_kg_per_m3)
        cause = f"{RAYLEIGH_FRACTION:g} of the Rayleigh time {time:.3g} s of spheres that unload"
        return cause, RAYLEIGH_FRACTION * time

    def _with(
        self,
        first: ElastoPlasticAdhesiveValues,
        second: ElastoPlasticAdhesiveValues,
        ratio: float,
        radius_m: float,
        mass_kg: float,
    ) -> ElastoPlasticAdhesivePair:
        """Two materials at a reduced radius and mass; all but the moduli is that of the second.

        k1 = 2 E* R* (exponent 1) or 4/3 E* sqrt(R*) (3/2); tangential TANGENTIAL_RATIO k1, or Mindlin's
        8 G* sqrt(R* overlap). Dashpots give the restitution on the spring k2.
        """

        normal, shear = reduced_compliances(first, second)
        damping = 2.0 * damping_ratio_at(second.restitution)
        if self.exponent == 1.0:
            stiffness = 2.0 * radius_m / normal
            tangential, slope = TANGENTIAL_RATIO * stiffness, stiffness
        else:
            root = math.sqrt(radius_m)
            stiffness, tangential = 4.0 / 3.0 * root / normal, 8.0 * root / shear
            slope = 1.5 * stiffness
            damping *= math.sqrt(5.0 / 6.0)
        slope /= 1.0 - second.contact_plasticity
        found = ElastoPlasticAdhesivePair(
            stiffness=stiffness,
            tangential_stiffness=tangential,
            damping=damping * math.sqrt(slope * mass_kg),
            tangential_damping=damping * math.sqrt(tangential * mass_kg),
            static_friction=second.static_friction,
            sliding_friction=second.sliding_friction,
            rolling_friction=second.rolling_friction,
            damping_of_restitution=True,
            exponent=self.exponent,
            contact_plasticity=second.contact_plasticity,
            adhesion_root=1.5 * math.pi * second.surface_energy_joule_per_m2 * math.sqrt(2.0 * radius_m),
            pull_off=second.pull_off_newton,
        )
        return found.scaled(ratio)
