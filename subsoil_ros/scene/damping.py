"""Lagged (semi-implicit) damping: dampers weakened so that larger steps stay stable. It changes the law.

The damper of one contact taken at the end of the step, m_eff du/dt = -C u, is the explicit one with
C / (1 + C dt / m_eff). A particle has several contacts whose dampers add up, and all of them see its new
velocity, so with z of them

    C_eff = C / (1 + z C dt / m_eff).

For two equal spheres m_eff = m/2 along the normal; tangentially the spins give way too,
1 / m_t = 2 (1/m + r^2/I) with I = 0.4 m r^2, so m_t = m/7: two sevenths of that. At a boundary, which does
not move, both are twice as large. C_eff depends on the step: as it goes to zero the explicit law comes back.
"""

from dataclasses import dataclass, replace

from .pairs import PairValues, pair_values, particle_mass_kg
from .soil import Soil

LAGGED_CONTACTS = 4.0
"""z: contacts whose dampers act on one relative motion (chosen: about that; a prototype's dense bed stayed
calm with it)."""

SMALLEST_RATIO = 0.5
"""C_eff / C below which the law is far from that of the scene (chosen); `force_lagged_damping` overrides."""

TANGENTIAL_PART = 2.0 / 7.0
"""Effective mass of a contact between spheres across the normal over that along it."""


@dataclass(frozen=True)
class DampingRatio:
    """C_eff / C of one kind of pair."""

    normal: float
    tangential: float

    @property
    def smallest(self) -> float:
        """The smaller of the two."""
        return min(self.normal, self.tangential)


def lag_rates(soil: Soil) -> tuple[tuple[float, float], tuple[float, float]]:
    """z C / m_eff [1/s] of pairs, then of contacts with a boundary: normal, tangential. Zero if explicit."""
    if soil.damping == "explicit":
        return (0.0, 0.0), (0.0, 0.0)
    mass = particle_mass_kg(soil)
    pair, boundary = (
        (
            LAGGED_CONTACTS * values.damping / effective,
            LAGGED_CONTACTS * values.tangential_damping / (TANGENTIAL_PART * effective),
        )
        for values, effective in zip(pair_values(soil), (0.5 * mass, mass), strict=True)
    )
    return pair, boundary


def damping_ratios(soil: Soil, step_s: float) -> tuple[DampingRatio, DampingRatio]:
    """C_eff / C of pairs and of contacts with a boundary at a soil step; 1 if damping is explicit."""
    pair, boundary = (
        DampingRatio(*(1.0 / (1.0 + rate * step_s) for rate in rates)) for rates in lag_rates(soil)
    )
    return pair, boundary


def integrated_values(soil: Soil, step_s: float) -> tuple[PairValues, PairValues]:
    """Laws of pairs and of contacts with a boundary as a soil step integrates them."""
    pair, boundary = (
        replace(
            values,
            damping=ratio.normal * values.damping,
            tangential_damping=ratio.tangential * values.tangential_damping,
        )
        for values, ratio in zip(pair_values(soil), damping_ratios(soil, step_s), strict=True)
    )
    return pair, boundary


def largest_lagged_step_s(soil: Soil) -> float:
    """Soil step at which the first C_eff / C comes down to SMALLEST_RATIO; infinite without dampers."""
    fastest = max(rate for rates in lag_rates(soil) for rate in rates)
    return (1.0 / SMALLEST_RATIO - 1.0) / fastest if fastest > 0.0 else float("inf")
