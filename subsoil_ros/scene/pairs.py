"""Pair laws of a scene: what two bodies in contact put on each other."""

import math
from dataclasses import dataclass, replace

from .soil import (
    CohesiveLinearLaw,
    ContactLaw,
    HertzMindlinLaw,
    HertzValues,
    LinearLaw,
    LinearValues,
    Soil,
    WetValues,
)


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
        """Values of spheres `ratio` times as large that make soil of the same strength and modulus.

        A bed of spheres of diameter d and density rho is a continuum of modulus K / d, strength
        K_B delta_B / d^2 and damping ratio C / sqrt(K m), with m ~ rho d^3. They stay what they are for

            K, K_t, K_B ~ ratio    C ~ ratio^2    delta_c, delta_B ~ ratio    friction, rho ~ 1

        and so do stress, strain and density; forces of contacts grow with ratio^2, overlaps and the time
        step (~ sqrt(m / K)) with ratio. What is as small as a particle is lost: the width of a shear band,
        the roughness of a surface, the teeth of a tool.
        """
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


def sphere_mass_kg(soil: Soil, radius_m: float) -> float:
    """Mass of a sphere of this radius [kg]."""
    return soil.particles.density_kg_per_m3 * 4.0 / 3.0 * math.pi * radius_m**3


def particle_mass_kg(soil: Soil) -> float:
    """Mass of one sphere, the mean of spheres of several sizes [kg]."""
    return sphere_mass_kg(soil, soil.particles.mean_volume_radius_m)


def layer_soils(soil: Soil) -> tuple[Soil, ...]:
    """The soil of every layer as one without layers, from top to bottom; without layers the soil itself.

    What a layer does not give is that of `soil.particles` and `soil.law`.
    """
    if soil.layers is None:
        return (soil,)
    found = []
    for layer in soil.layers:
        density = layer.density_kg_per_m3 or soil.particles.density_kg_per_m3
        update: dict[str, object] = {
            "layers": None,
            "particles": soil.particles.model_copy(update={"density_kg_per_m3": density}),
        }
        if layer.law is not None:
            rows = {
                key: getattr(soil.law, key).model_copy(
                    update=getattr(layer.law, key).model_dump(exclude_none=True)
                )
                for key in ("particle", "boundary")
            }
            update["law"] = soil.law.model_copy(update=rows)
        found.append(soil.model_copy(update=update))
    return tuple(found)


def size_ratio(soil: Soil) -> float:
    """Radius of the particles over the radius that the law's values hold for."""
    radius = soil.particles.mean_volume_radius_m
    return radius / (soil.particles.reference_radius_m or radius)


def pair_values(soil: Soil) -> tuple[PairValues, PairValues]:
    """Laws of the pairs particle-particle and particle-boundary, two spheres of mean volume.

    Of a soil with layers, those of `soil.law`: ask for each of `layer_soils`.
    """
    radius, mass = soil.particles.mean_volume_radius_m, particle_mass_kg(soil)
    return (
        particle_values(soil, soil, 0.5 * radius, 0.5 * mass),
        boundary_values(soil, radius, mass),
    )


def particle_values(first: Soil, second: Soil, radius_m: float, mass_kg: float) -> PairValues:
    """Law of two particles, one of each soil (without layers; the same one for a like pair).

    radius_m, mass_kg: reduced ones of the pair, r1 r2 / (r1 + r2) and m1 m2 / (m1 + m2); Hertz needs them.
    Wet and linear laws are scaled to the mean radius of the particles where the scene asks for it.
    Unlike particles: springs, dampers and adhesions of the two in series, a value that stands for a like pair
    being half of a body's (eq. 15, 16, 18); rest overlap and reach the mean of the two, each body bringing
    its half; friction and restitution the smaller, the weaker surface yielding first. Hertz: E* and G* of
    two materials.
    """
    one, other, ratio = first.law, second.law, size_ratio(first)
    if isinstance(one, CohesiveLinearLaw) and isinstance(other, CohesiveLinearLaw):
        if first is second:
            return _wet(one, one.particle, in_series=one.combining_rule == "series").scaled(ratio)
        found = _wet(one, other.particle, in_series=True)
        if one.combining_rule == "none":
            found = _doubled(found)
        found = replace(
            found,
            rest_overlap=0.5 * (one.particle.equilibrium_overlap_m + other.particle.equilibrium_overlap_m),
            reach=0.5 * (one.particle.cohesion_range_m + other.particle.cohesion_range_m),
        )
        return _with_weaker_friction(found.scaled(ratio), one, other)
    if isinstance(one, LinearLaw) and isinstance(other, LinearLaw):
        found = _linear(one.particle)
        if first is second:
            return found.scaled(ratio)
        theirs = _linear(other.particle)
        halves = replace(
            found,
            stiffness=_series(found.stiffness, theirs.stiffness),
            tangential_stiffness=_series(found.tangential_stiffness, theirs.tangential_stiffness),
            damping=_series(found.damping, theirs.damping),
            tangential_damping=_series(found.tangential_damping, theirs.tangential_damping),
        )
        return _with_weaker_friction(_doubled(halves).scaled(ratio), one, other)
    assert isinstance(one, HertzMindlinLaw)
    assert isinstance(other, HertzMindlinLaw)
    restitution = min(one.particle.restitution, other.particle.restitution)
    found = _hertz(one.particle, other.particle, restitution, radius_m, mass_kg)
    return _with_weaker_friction(found, one, other)


def boundary_values(soil: Soil, radius_m: float, mass_kg: float) -> PairValues:
    """Law of a particle of this radius and mass at a wall; soil without layers."""
    law = soil.law
    if isinstance(law, CohesiveLinearLaw):
        return _wet(law, law.boundary, in_series=law.combining_rule == "series").scaled(size_ratio(soil))
    if isinstance(law, LinearLaw):
        return _linear(law.boundary).scaled(size_ratio(soil))
    return _hertz(law.particle, law.boundary, law.boundary.restitution, radius_m, mass_kg)


def tool_values(soil: Soil) -> PairValues:
    """Law of particle and tool: that of the boundary with its normal stiffness times the tool's factor."""
    boundary = pair_values(soil)[1]
    return replace(boundary, stiffness=boundary.stiffness * soil.tool_stiffness_factor)


def _series(first: float, second: float) -> float:
    """Two springs (or dampers) in series, eq. 15, 16, 18; zero if either is."""
    total = first + second
    return first * second / total if total > 0.0 else 0.0


def _doubled(values: PairValues) -> PairValues:
    """Pair values from halves in series: two of 2 K in series are twice two of K."""
    return replace(
        values,
        stiffness=2.0 * values.stiffness,
        tangential_stiffness=2.0 * values.tangential_stiffness,
        damping=2.0 * values.damping,
        tangential_damping=2.0 * values.tangential_damping,
        adhesion=2.0 * values.adhesion,
    )


def _with_weaker_friction(values: PairValues, first: ContactLaw, second: ContactLaw) -> PairValues:
    """`values` with the smaller friction of two particles."""
    one, other = first.particle, second.particle
    return replace(
        values,
        static_friction=min(one.static_friction, other.static_friction),
        sliding_friction=min(one.sliding_friction, other.sliding_friction),
        rolling_friction=min(one.rolling_friction, other.rolling_friction),
    )


def _wet(law: CohesiveLinearLaw, second: WetValues, *, in_series: bool) -> PairValues:
    """Particle with `second`: body values combined as springs in series, or pair values as they stand.

    Distances and friction are not combined: those of the row stand for the pair.
    """

    def value(key: str) -> float:
        own = getattr(second, key)
        return _series(getattr(law.particle, key), own) if in_series else own

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


def _hertz(
    first: HertzValues, second: HertzValues, restitution: float, radius_m: float, mass_kg: float
) -> PairValues:
    """Two materials at an effective radius and mass; friction is that of the second.

    F_n = 4/3 E* sqrt(R*) delta^1.5, S_t = 8 G* sqrt(R* delta); dashpots 2 sqrt(5/6) beta sqrt(S m*) with
    S_n = 2 E* sqrt(R* delta), which give a restitution that does not depend on speed (Y. Tsuji, T. Tanaka,
    T. Ishida, Powder Technology 71 (1992) 239-250).
    """

    def compliance(row: HertzValues) -> tuple[float, float]:
        nu, young = row.poisson_ratio, row.youngs_modulus_pa
        return (1.0 - nu**2) / young, 2.0 * (2.0 - nu) * (1.0 + nu) / young

    normal, tangential = (a + b for a, b in zip(compliance(first), compliance(second), strict=True))
    root = math.sqrt(radius_m)
    stiffness, shear = 2.0 * root / normal, 8.0 * root / tangential  # S_n, S_t per root of overlap
    log_e = math.log(restitution)
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
