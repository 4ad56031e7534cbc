"""Elastic spheres with a dashpot of given restitution."""

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from ...strict_model import Fraction, NonNegative, PoissonRatio, Positive, StrictModel
from ..base import ContactLaw, PairValues, with_weaker_friction
from ..dampers import damping_ratio_at

RAYLEIGH_FRACTION = 0.2
"""Fraction of the Rayleigh time that a step may take (usual: 0.1 to 0.2)."""


class HertzNumbers(NamedTuple):
    """Numbers of one kind of pair. SI; stiffnesses per root of overlap, dampings per fourth root."""

    stiffness: float  # [N/m^1.5]
    tangential_stiffness: float  # [N/m^1.5]
    damping: float  # [N s/m^1.25]
    tangential_damping: float  # [N s/m^1.25]
    static_friction: float
    sliding_friction: float
    rolling_stiffness: float  # S_t R_eff^2 [N m^0.5/rad]
    rolling_arm: float  # mu_r R_eff [m]: torque limit over normal force


@dataclass(frozen=True)
class HertzPair(PairValues):
    """Stiffnesses are per root of overlap [N/m^1.5], dampings per fourth root [N s/m^1.25]."""

    def loaded_m(self, force_newton: float) -> float:
        """Overlap at which the elastic part carries `force_newton` [m]."""
        return float((force_newton / self.stiffness) ** (2.0 / 3.0))

    def scaled(self, ratio: float) -> "HertzPair":
        """These values: moduli are given, and stiffnesses follow from them and the size."""
        return self

    def linear_at(self, overlap_m: float) -> PairValues:
        """Springs and dashpots in N/m and N s/m at this overlap."""
        root = math.sqrt(overlap_m)
        return springs_at(self, 1.5 * self.stiffness * root, root)


class HertzValues(StrictModel):
    """A material; restitution and friction of the `boundary` row stand for particle and boundary."""

    youngs_modulus_pa: Positive
    poisson_ratio: PoissonRatio
    restitution: Fraction
    static_friction: NonNegative
    sliding_friction: NonNegative
    rolling_friction: NonNegative = 0.0


class HertzMindlinLaw(ContactLaw):
    """Elastic spheres (Hertz) with Mindlin's tangential stiffness and a dashpot of given restitution."""

    kind: Literal["hertz_mindlin"]
    particle: HertzValues
    boundary: HertzValues

    numbers = HertzNumbers

    def pair(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """Two particles under this law."""
        return self.mixed_pair(self, ratio, radius_m, mass_kg)

    def mixed_pair(
        self, other: "HertzMindlinLaw", ratio: float, radius_m: float, mass_kg: float
    ) -> PairValues:
        """E* and G* of two materials; the smaller friction and restitution."""
        one, two = self.particle, other.particle
        restitution = min(one.restitution, two.restitution)
        return with_weaker_friction(_values(one, two, restitution, radius_m, mass_kg), one, two)

    def at_boundary(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """A particle at a wall or tool."""
        return _values(self.particle, self.boundary, self.boundary.restitution, radius_m, mass_kg)

    @classmethod
    def numbers_of(cls, values: PairValues, radius_m: float) -> HertzNumbers:
        """Numbers of a pair."""
        return HertzNumbers(
            stiffness=values.stiffness,
            tangential_stiffness=values.tangential_stiffness,
            damping=values.damping,
            tangential_damping=values.tangential_damping,
            static_friction=values.static_friction,
            sliding_friction=values.sliding_friction,
            rolling_stiffness=values.tangential_stiffness * radius_m**2,
            rolling_arm=values.rolling_friction * radius_m,
        )

    def wave_limit(self, radius_m: float, density_kg_per_m3: float) -> tuple[str, float]:
        """Part of the Rayleigh time of a sphere."""
        row = self.particle
        time = rayleigh_time_s(row.youngs_modulus_pa, row.poisson_ratio, radius_m, density_kg_per_m3)
        return f"{RAYLEIGH_FRACTION:g} of the Rayleigh time {time:.3g} s", RAYLEIGH_FRACTION * time


def rayleigh_time_s(youngs_modulus_pa: float, nu: float, radius_m: float, density_kg_per_m3: float) -> float:
    """Time of a Rayleigh wave around half a sphere, pi r sqrt(rho / G) / (0.1631 nu + 0.8766).

    Source: Y. Li, Y. Xu, C. Thornton, Powder Technology 160 (2005) 219-228.
    """
    shear = youngs_modulus_pa / (2.0 * (1.0 + nu))
    return math.pi * radius_m * math.sqrt(density_kg_per_m3 / shear) / (0.1631 * nu + 0.8766)


def springs_at(values: PairValues, stiffness: float, root: float) -> PairValues:
    """Linear springs of a pair whose tangential stiffness is proportional to the root [m^0.5] of its overlap,
    and dampers to the root of that; `stiffness` [N/m] is the tangent along the normal."""
    return PairValues(
        stiffness=stiffness,
        tangential_stiffness=values.tangential_stiffness * root,
        damping=values.damping * math.sqrt(root),
        tangential_damping=values.tangential_damping * math.sqrt(root),
        static_friction=values.static_friction,
        sliding_friction=values.sliding_friction,
        rolling_friction=values.rolling_friction,
    )


def reduced_compliances(first: Any, second: Any) -> tuple[float, float]:
    """1 / E* and 1 / G* [1/Pa] of two rows with youngs_modulus_pa and poisson_ratio (Johnson 1985)."""

    def compliance(row: Any) -> tuple[float, float]:
        nu, young = row.poisson_ratio, row.youngs_modulus_pa
        return (1.0 - nu**2) / young, 2.0 * (2.0 - nu) * (1.0 + nu) / young

    (normal, shear), (other_normal, other_shear) = compliance(first), compliance(second)
    return normal + other_normal, shear + other_shear


def _values(
    first: HertzValues, second: HertzValues, restitution: float, radius_m: float, mass_kg: float
) -> HertzPair:
    """Two materials at an effective radius and mass; friction is that of the second.

    F_n = 4/3 E* sqrt(R*) delta^1.5, S_t = 8 G* sqrt(R* delta); dashpots 2 sqrt(5/6) beta sqrt(S m*) with
    S_n = 2 E* sqrt(R* delta), which give a restitution that does not depend on speed (Y. Tsuji, T. Tanaka,
    T. Ishida, Powder Technology 71 (1992) 239-250).
    """

    normal, tangential = reduced_compliances(first, second)
    root = math.sqrt(radius_m)
    stiffness, shear = 2.0 * root / normal, 8.0 * root / tangential  # S_n, S_t per root of overlap
    dashpot = 2.0 * math.sqrt(5.0 / 6.0) * damping_ratio_at(restitution)
    return HertzPair(
        stiffness=2.0 / 3.0 * stiffness,
        tangential_stiffness=shear,
        damping=dashpot * math.sqrt(stiffness * mass_kg),
        tangential_damping=dashpot * math.sqrt(shear * mass_kg),
        static_friction=second.static_friction,
        sliding_friction=second.sliding_friction,
        rolling_friction=second.rolling_friction,
    )
