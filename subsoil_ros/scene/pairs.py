"""Pair laws of a scene: what two bodies in contact put on each other."""

import math
from dataclasses import dataclass, replace

from .soil import HertzMindlinLaw, HertzValues, LinearLaw, LinearValues, Soil, WetLaw, WetValues


@dataclass(frozen=True)
class PairValues:
    """Law of one kind of pair, SI; what the contact kernels take.

    Hertzian: stiffnesses are per root of overlap [N/m^1.5], dampings per fourth root [N s/m^1.25].
    """

    stiffness: float  # K_X [N/m]
    tangential_stiffness: float  # K_Y = K_Z [N/m]
    damping: float  # C_X [N s/m]
    tangential_damping: float  # C_Y = C_Z [N s/m]
    static_friction: float
    sliding_friction: float
    rolling_friction: float
    adhesion: float = 0.0  # K_B [N/m]
    rest_overlap: float = 0.0  # delta_c [m]
    reach: float = 0.0  # delta_B [m]
    hertzian: bool = False

    @property
    def contact_adhesion(self) -> float:
        """K_C = K_B delta_B / delta_c [N/m] (eq. 20)."""
        return self.adhesion * self.reach / self.rest_overlap if self.adhesion > 0.0 else 0.0

    @property
    def peak_attraction(self) -> float:
        """Largest attraction, at touch: K_B delta_B [N]."""
        return self.adhesion * self.reach

    def loaded_m(self, force_newton: float) -> float:
        """Overlap beyond rest at which the elastic part carries `force_newton` [m]."""
        return (force_newton / self.stiffness) ** (2.0 / 3.0 if self.hertzian else 1.0)

    def scaled(self, ratio: float) -> "PairValues":
        """Of spheres `ratio` times as large that make soil of the same strength and modulus (scaling.py)."""
        if self.hertzian:  # follows from the materials: moduli, not stiffnesses, are given
            return self
        return replace(
            self,
            stiffness=ratio * self.stiffness,
            tangential_stiffness=ratio * self.tangential_stiffness,
            damping=ratio**2 * self.damping,
            tangential_damping=ratio**2 * self.tangential_damping,
            adhesion=ratio * self.adhesion,
            rest_overlap=ratio * self.rest_overlap,
            reach=ratio * self.reach,
        )

    def linear_at(self, overlap_m: float) -> "PairValues":
        """Springs and dashpots in N/m and N s/m at this overlap; themselves unless Hertzian."""
        if not self.hertzian:
            return self
        root = math.sqrt(overlap_m)
        return replace(
            self,
            hertzian=False,
            stiffness=1.5 * self.stiffness * root,
            tangential_stiffness=self.tangential_stiffness * root,
            damping=self.damping * math.sqrt(root),
            tangential_damping=self.tangential_damping * math.sqrt(root),
        )


def particle_mass_kg(soil: Soil) -> float:
    """Mass of one sphere [kg]."""
    return soil.particles.density_kg_per_m3 * 4.0 / 3.0 * math.pi * soil.particles.radius_m**3


def size_ratio(soil: Soil) -> float:
    """Radius of the particles over the radius that the law's values hold for."""
    return soil.particles.radius_m / (soil.particles.law_radius_m or soil.particles.radius_m)


def pair_values(soil: Soil) -> tuple[PairValues, PairValues]:
    """Laws of the pairs particle-particle and particle-boundary, scaled to the radius of the particles."""
    law, ratio = soil.law, size_ratio(soil)
    if isinstance(law, WetLaw):
        return _wet(law, law.particle).scaled(ratio), _wet(law, law.boundary).scaled(ratio)
    if isinstance(law, LinearLaw):
        return _linear(law.particle).scaled(ratio), _linear(law.boundary).scaled(ratio)
    radius, mass = soil.particles.radius_m, particle_mass_kg(soil)
    return (
        _hertz(law, law.particle, 0.5 * radius, 0.5 * mass),
        _hertz(law, law.boundary, radius, mass),
    )


def tool_values(soil: Soil) -> PairValues:
    """Law of particle and tool: that of the boundary with its normal stiffness times the tool's factor."""
    boundary = pair_values(soil)[1]
    return replace(boundary, stiffness=boundary.stiffness * soil.tool_stiffness_factor)


def _series(first: float, second: float) -> float:
    """Two springs (or dampers) in series, eq. 15, 16, 18; zero if either is."""
    total = first + second
    return first * second / total if total > 0.0 else 0.0


def _wet(law: WetLaw, second: WetValues) -> PairValues:
    """Particle with `second`: body values combined as springs in series, or pair values as they stand.

    Distances and friction are not combined: those of the row stand for the pair.
    """

    def value(key: str) -> float:
        own = getattr(second, key)
        return _series(getattr(law.particle, key), own) if law.values_are == "body" else own

    return PairValues(
        stiffness=value("stiffness_newton_per_m"),
        tangential_stiffness=value("tangential_stiffness_newton_per_m"),
        damping=value("damping_newton_s_per_m"),
        tangential_damping=value("tangential_damping_newton_s_per_m"),
        static_friction=second.static_friction,
        sliding_friction=second.sliding_friction,
        rolling_friction=second.rolling_friction,
        adhesion=value("adhesion_newton_per_m"),
        rest_overlap=second.rest_overlap_m,
        reach=second.reach_m,
    )


def _linear(row: LinearValues) -> PairValues:
    return PairValues(
        row.stiffness_newton_per_m,
        row.tangential_stiffness_newton_per_m,
        row.damping_newton_s_per_m,
        row.tangential_damping_newton_s_per_m,
        row.static_friction,
        row.sliding_friction,
        row.rolling_friction,
    )


def _hertz(law: HertzMindlinLaw, second: HertzValues, radius_m: float, mass_kg: float) -> PairValues:
    """Particle with `second` at an effective radius and mass.

    F_n = 4/3 E* sqrt(R*) delta^1.5, S_t = 8 G* sqrt(R* delta); dashpots 2 sqrt(5/6) beta sqrt(S m*) with
    S_n = 2 E* sqrt(R* delta), which give a restitution that does not depend on speed (Y. Tsuji, T. Tanaka,
    T. Ishida, Powder Technology 71 (1992) 239-250).
    """
    first = law.particle

    def compliance(row: HertzValues) -> tuple[float, float]:
        nu, young = row.poisson_ratio, row.youngs_modulus_pa
        return (1.0 - nu**2) / young, 2.0 * (2.0 - nu) * (1.0 + nu) / young

    normal, tangential = (a + b for a, b in zip(compliance(first), compliance(second), strict=True))
    root = math.sqrt(radius_m)
    stiffness, shear = 2.0 * root / normal, 8.0 * root / tangential  # S_n, S_t per root of overlap
    log_e = math.log(second.restitution)
    beta = -log_e / math.hypot(log_e, math.pi)
    dashpot = 2.0 * math.sqrt(5.0 / 6.0) * beta
    return PairValues(
        stiffness=2.0 / 3.0 * stiffness,
        tangential_stiffness=shear,
        damping=dashpot * math.sqrt(stiffness * mass_kg),
        tangential_damping=dashpot * math.sqrt(shear * mass_kg),
        static_friction=second.static_friction,
        sliding_friction=second.sliding_friction,
        rolling_friction=second.rolling_friction,
        hertzian=True,
    )
