"""Linear springs and dashpots."""

from dataclasses import replace
from typing import Literal, NamedTuple

from ...strict_model import NonNegative
from ..base import PairValues, doubled, series, with_weaker_friction
from ..dampers import DampedLaw, DampedValues, damped, smaller_restitution


class LinearNumbers(NamedTuple):
    """Numbers of one kind of pair. SI."""

    stiffness: float  # [N/m]
    tangential_stiffness: float  # [N/m]
    damping: float  # [N s/m]
    tangential_damping: float  # [N s/m]
    static_friction: float
    sliding_friction: float
    rolling_stiffness: float  # K_t R_eff^2 [N m/rad]
    rolling_arm: float  # mu_r R_eff [m]: torque limit over normal force
    of_restitution: float = 0.0  # 1: dampers go with the root of the reduced mass, 0: they do not


class LinearValues(DampedValues):
    """A spring and a dashpot, as they stand for the pair.

    `restitution` replaces both dampings. Frictions are coefficients: rolling_friction mu_r limits the rolling
    torque to mu_r R_eff F_n.
    """

    static_friction: NonNegative
    sliding_friction: NonNegative
    rolling_friction: NonNegative = 0.0


class LinearLaw(DampedLaw):
    """Dry spheres with linear springs and dashpots, acting while they overlap."""

    kind: Literal["linear"]
    particle: LinearValues
    boundary: LinearValues

    numbers = LinearNumbers
    linear_springs = True

    def pair(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """Two particles under this law."""
        return damped(_values(self.particle).scaled(ratio), self.particle.restitution, mass_kg)

    def mixed_pair(self, other: "LinearLaw", ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """Springs and dampers in series, a value being half of a body's; the smaller friction and
        restitution."""
        found, theirs = _values(self.particle), _values(other.particle)
        halves = replace(
            found,
            stiffness=series(found.stiffness, theirs.stiffness),
            tangential_stiffness=series(found.tangential_stiffness, theirs.tangential_stiffness),
            damping=series(found.damping, theirs.damping),
            tangential_damping=series(found.tangential_damping, theirs.tangential_damping),
        )
        found = with_weaker_friction(doubled(halves).scaled(ratio), self.particle, other.particle)
        return damped(found, smaller_restitution(self.particle, other.particle), mass_kg)

    def at_boundary(self, ratio: float, radius_m: float, mass_kg: float) -> PairValues:
        """A particle at a wall or tool."""
        return damped(_values(self.boundary).scaled(ratio), self.boundary.restitution, mass_kg)

    @classmethod
    def numbers_of(cls, values: PairValues, radius_m: float) -> LinearNumbers:
        """Numbers of a pair."""
        return LinearNumbers(
            stiffness=values.stiffness,
            tangential_stiffness=values.tangential_stiffness,
            damping=values.damping,
            tangential_damping=values.tangential_damping,
            static_friction=values.static_friction,
            sliding_friction=values.sliding_friction,
            rolling_stiffness=values.tangential_stiffness * radius_m**2,
            rolling_arm=values.rolling_friction * radius_m,
            of_restitution=float(values.damping_of_restitution),
        )


def _values(row: LinearValues) -> PairValues:
    return PairValues(
        row.stiffness_newton_per_m,
        row.tangential_stiffness_newton_per_m,
        row.damping_newton_s_per_m or 0.0,
        row.tangential_damping_newton_s_per_m or 0.0,
        row.static_friction,
        row.sliding_friction,
        row.rolling_friction,
    )
