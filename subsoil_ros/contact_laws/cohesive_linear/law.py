"""The law of Yuan & Yu (2020), eq. 12-21, for wet particles."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from ...strict_model import NonNegative, Positive
from ..base import NO, PairValues, doubled, series, with_weaker_friction
from ..dampers import DampedLaw, DampedValues, damped, smaller_restitution


class CohesiveLinearNumbers(NamedTuple):
    """Numbers of one kind of pair. SI."""

    stiffness: float  # K_X [N/m]
    tangential_stiffness: float  # K_Y = K_Z [N/m]
    damping: float  # C_X [N s/m]
    tangential_damping: float  # C_Y = C_Z [N s/m]
    adhesion: float  # K_B [N/m]
    contact_adhesion: float  # K_C [N/m]
    rest_overlap: float  # delta_c [m]
    reach: float  # delta_B [m]
    peak_attraction: float  # K_B delta_B [N]
    static_friction: float
    sliding_friction: float
    rolling_stiffness: float  # K_Y R_eff^2 [N m/rad]
    rolling_arm: float  # mu_r R_eff [m]: torque limit over normal force
    of_restitution: float = 0.0  # 1: dampers go with the root of the reduced mass, 0: they do not


class CohesiveLinearFeatures(NamedTuple):
    """Features with those of this law."""

    tangential: np.ndarray
    rolling: np.ndarray
    book: np.ndarray
    sizes: np.ndarray = NO
    materials: np.ndarray = NO
    periodic: np.ndarray = NO
    cohesion: np.ndarray = NO
    damp_all_zones: np.ndarray = NO
    friction_repulsive: np.ndarray = NO  # neither of the two: friction is limited by F_n + F_peak
    friction_absolute: np.ndarray = NO


class CohesiveLinearValues(DampedValues):
    """One row of table 3 of the paper.

    `restitution` replaces both dampings. Frictions are coefficients: rolling_friction mu_r limits the rolling
    torque to mu_r R_eff F_n.
    """

    stiffness_newton_per_m: Positive = Field(description="K_X.")
    tangential_stiffness_newton_per_m: NonNegative = Field(description="K_Y, K_Z.")
    damping_newton_s_per_m: NonNegative | None = Field(None, description="C_X.")
    tangential_damping_newton_s_per_m: NonNegative | None = Field(None, description="C_Y, C_Z.")
    cohesive_stiffness_newton_per_m: NonNegative = Field(description="K_B.")
    static_friction: NonNegative
    sliding_friction: NonNegative
    rolling_friction: NonNegative
    equilibrium_overlap_m: Positive = Field(description="delta_c.")
    cohesion_range_m: Positive = Field(description="delta_B.")


class CohesiveLinearLaw(DampedLaw):
    """The paper's law of wet particles (eq. 12-21), its adjustment distance Delta being 0.

    `combining_rule` says how the two rows are read: `series`, those of a body, combined by eq. 15, 16 and 18
    (a pair of equal bodies has half of each value), or `none`, those of the pair, used as they stand.
    `friction_normal` is the normal force that limits friction; the normal dashpot acts in `damped_zones`.
    """

    kind: Literal["cohesive_linear"]
    combining_rule: Literal["series", "none"] = "series"
    particle: CohesiveLinearValues
    boundary: CohesiveLinearValues
    friction_normal: Literal["total", "repulsive", "absolute"] = "total"
    damped_zones: Literal["repulsive", "all"] = "repulsive"

    numbers = CohesiveLinearNumbers
    features = CohesiveLinearFeatures
    linear_springs = True

    def pair(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """Two particles under this law."""
        found = self._with(self.particle, in_series=self.combining_rule == "series").scaled(ratio)
        return damped(found, self.particle.restitution, mass_kg)

    def mixed_pair(
        self, other: "CohesiveLinearLaw", ratio: float, radius_m: float, mass_kg: float
    ) -> PairValues:
        """Springs, dampers and adhesions of the two in series, those of a like pair being half of a body's;
        mean rest overlap and reach, as each body contributes half; the smaller friction and restitution."""
        found = self._with(other.particle, in_series=True)
        if self.combining_rule == "none":
            found = doubled(found)
        one, two = self.particle, other.particle
        found = replace(
            found,
            rest_overlap=0.5 * (one.equilibrium_overlap_m + two.equilibrium_overlap_m),
            reach=0.5 * (one.cohesion_range_m + two.cohesion_range_m),
        )
        found = with_weaker_friction(found.scaled(ratio), one, two)
        return damped(found, smaller_restitution(one, two), mass_kg)

    def at_boundary(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """A particle at a wall or tool."""
        found = self._with(self.boundary, in_series=self.combining_rule == "series").scaled(ratio)
        return damped(found, self.boundary.restitution, mass_kg)

    @classmethod
    def numbers_of(cls, values: PairValues, radius_m: float) -> CohesiveLinearNumbers:
        """Numbers of a pair."""
        return CohesiveLinearNumbers(
            stiffness=values.stiffness,
            tangential_stiffness=values.tangential_stiffness,
            damping=values.damping,
            tangential_damping=values.tangential_damping,
            adhesion=values.adhesion,
            contact_adhesion=values.contact_adhesion,
            rest_overlap=values.rest_overlap,
            reach=values.reach,
            peak_attraction=values.peak_attraction,
            static_friction=values.static_friction,
            sliding_friction=values.sliding_friction,
            rolling_stiffness=values.tangential_stiffness * radius_m**2,
            rolling_arm=values.rolling_friction * radius_m,
            of_restitution=float(values.damping_of_restitution),
        )

    def own_features(self, values: Sequence[PairValues]) -> dict[str, bool]:
        """See ContactLaw; cohesion is left out if no pair has any."""
        return {
            "cohesion": any(found.adhesion > 0.0 for found in values),
            "damp_all_zones": self.damped_zones == "all",
            "friction_repulsive": self.friction_normal == "repulsive",
            "friction_absolute": self.friction_normal == "absolute",
        }

    def rest_overlaps_m(self) -> tuple[float, float]:
        """delta_c of the rows."""
        return self.particle.equilibrium_overlap_m, self.boundary.equilibrium_overlap_m

    def _with(self, second: CohesiveLinearValues, *, in_series: bool) -> PairValues:
        """Particle with `second`: body values combined as springs in series, or pair values as they stand.

        Distances, friction and restitution are not combined: those of the row stand for the pair.
        """

        def value(key: str) -> float:
            own: float = getattr(second, key) or 0.0
            return series(getattr(self.particle, key) or 0.0, own) if in_series else own

        return PairValues(
            stiffness=value("stiffness_newton_per_m"),
            tangential_stiffness=value("tangential_stiffness_newton_per_m"),
            damping=value("damping_newton_s_per_m"),
            tangential_damping=value("tangential_damping_newton_s_per_m"),
            static_friction=second.static_friction,
            sliding_friction=second.sliding_friction,
            rolling_friction=second.rolling_friction,
            adhesion=value("cohesive_stiffness_newton_per_m"),
            rest_overlap=second.equilibrium_overlap_m,
            reach=second.cohesion_range_m,
        )
