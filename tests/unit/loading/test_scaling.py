"""Larger particles for the same soil: every number without dimension is kept."""

import math
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from subsoil_ros.contact_laws.base import PairValues
from subsoil_ros.contact_laws.elasto_plastic_adhesive.law import ElastoPlasticAdhesivePair
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.pair_laws import pair_values, particle_mass_kg
from subsoil_ros.scene.soil import Soil

SCENES = Path(__file__).parents[3] / "config" / "scenes"
RATIO = 1.7
STRESS_PA = 20e3
ROW = {"static_friction": 0.5, "sliding_friction": 0.4, "rolling_friction": 0.1}
SPRINGS = ROW | {
    "stiffness_newton_per_m": 2e4,
    "tangential_stiffness_newton_per_m": 1e4,
    "damping_newton_s_per_m": 3.0,
    "tangential_damping_newton_s_per_m": 2.0,
}
MATERIAL = ROW | {"youngs_modulus_pa": 1e7, "poisson_ratio": 0.3, "restitution": 0.6}
YIELDING = MATERIAL | {"contact_plasticity": 0.6}


def soil_of(law: dict | None) -> Soil:
    soil = load_scene(SCENES / "tine.yaml").scene.soil
    assert soil is not None
    if law is None:
        return soil
    return Soil.model_validate(soil.model_dump() | {"law": law})


LAWS = {
    "wet": None,
    "linear": {"kind": "linear", "particle": SPRINGS, "boundary": SPRINGS | {"stiffness_newton_per_m": 5e4}},
    "hertz_mindlin": {"kind": "hertz_mindlin", "particle": MATERIAL, "boundary": MATERIAL},
    "elasto_plastic_adhesive": {
        "kind": "elasto_plastic_adhesive", "particle": YIELDING, "boundary": YIELDING, "exponent": 1.5,
    },
}  # fmt: skip


OF_MODULI = ("hertz_mindlin", "elasto_plastic_adhesive")


def scaled(soil: Soil, ratio: float) -> Soil:
    """Larger particles under the law of the smaller ones."""
    radius = soil.particles.radius_m
    assert radius is not None
    update = {"radius_m": ratio * radius, "reference_radius_m": radius}
    return soil.model_copy(update={"particles": soil.particles.model_copy(update=update)})


def dimensionless(values: PairValues, diameter_m: float, density_kg_per_m3: float) -> list[float]:
    """Numbers that say how a bed behaves under STRESS_PA: two with the same numbers are the same soil."""
    mass = density_kg_per_m3 * math.pi / 6.0 * diameter_m**3
    linear = values.linear_at(values.loaded_m(STRESS_PA * diameter_m**2))
    return [
        linear.stiffness / (STRESS_PA * diameter_m),
        linear.tangential_stiffness / linear.stiffness,
        linear.damping / math.sqrt(4.0 * linear.stiffness * 0.5 * mass),
        linear.tangential_damping / math.sqrt(2.0 * linear.stiffness * mass),
        values.peak_attraction / (STRESS_PA * diameter_m**2),
        values.contact_adhesion / linear.stiffness,
        values.rest_overlap / diameter_m,
        values.reach / diameter_m,
        values.static_friction,
        values.sliding_friction,
        values.rolling_friction,
    ]


@pytest.mark.parametrize("name", LAWS)
def test_every_number_without_dimension_is_kept(name: str) -> None:
    """Both pairs, for each law, to round-off; unscaled, the same numbers differ (but for laws of moduli)."""
    soil = soil_of(LAWS[name])
    larger = scaled(soil, RATIO)
    unscaled = larger.model_copy(
        update={"particles": larger.particles.model_copy(update={"reference_radius_m": None})}
    )

    def numbers(of: Soil, which: int) -> list[float]:
        values = pair_values(of)[which]
        return dimensionless(values, 2.0 * of.particles.radius_m, of.particles.density_kg_per_m3)

    for which in (0, 1):
        assert_allclose(numbers(larger, which), numbers(soil, which), rtol=1e-12)
        changed = abs(numbers(unscaled, which)[0] / numbers(soil, which)[0] - 1.0)
        assert changed < 1e-12 if name in OF_MODULI else changed > 0.1


def test_forces_and_the_stable_step_grow_with_the_radius() -> None:
    """The stable step ~ s; forces ~ s^2, mass ~ s^3."""
    soil = soil_of(None)
    larger = scaled(soil, RATIO)
    pair, wide = pair_values(soil)[0], pair_values(larger)[0]
    assert_allclose(wide.peak_attraction / pair.peak_attraction, RATIO**2, rtol=1e-12)
    assert_allclose(particle_mass_kg(larger) / particle_mass_kg(soil), RATIO**3, rtol=1e-12)
    for old, new in zip(step_limits(soil), step_limits(larger), strict=True):
        assert_allclose(new.limit_s / old.limit_s, RATIO, rtol=1e-12)


def test_dashpots_of_hertz_and_mindlin_limit_the_step_where_they_are_strong() -> None:
    """Restitution 0.1 (Tsuji et al. 1992; Antypov and Elliott 2011): 2 over the rate of spins at an overlap
    of 5 %, below 0.2 of the Rayleigh time; at 0.6 the waves count."""
    bouncing = MATERIAL | {"restitution": 0.1}
    soil = soil_of({"kind": "hertz_mindlin", "particle": bouncing, "boundary": bouncing})
    radius = soil.particles.bounds_m[0]
    mass = particle_mass_kg(soil)
    shear = MATERIAL["youngs_modulus_pa"] / (2.0 * (1.0 + 0.3)) / (2.0 * (2.0 - 0.3))
    tangential = 8.0 * shear * math.sqrt(0.5 * radius * 0.05 * radius)
    ratio = -math.log(0.1) / math.hypot(math.pi, math.log(0.1))
    damping = 2.0 * math.sqrt(5.0 / 6.0) * ratio * math.sqrt(tangential * 0.5 * mass)
    rate = 4.0 / 3.0 * 10.4 * damping * radius**2 / (0.4 * mass * radius**2)
    first = step_limits(soil)[0]
    assert (first.limit_s, first.damped) == (pytest.approx(2.0 / rate, rel=1e-9), True)
    assert not step_limits(soil_of(LAWS["hertz_mindlin"]))[0].damped


def test_a_scene_asks_for_it_by_the_radius_of_the_law() -> None:
    """particles.reference_radius_m scales the law of a scene."""
    given = [
        "soil.particles.radius_m=0.015",
        "soil.particles.reference_radius_m=0.01",
        "soil.bed.spacing_m=rest",
    ]
    scene = load_scene(SCENES / "tine.yaml", given).scene
    assert scene.soil is not None
    assert pair_values(scene.soil) == pair_values(scaled(soil_of(None), 1.5))


def test_attraction_of_plastic_spheres_keeps_the_strength() -> None:
    """Pull-off forces go with the square of the radius, those of a surface energy as well: overlaps and the
    energy itself go with the radius."""
    sticky = YIELDING | {"pull_off_newton": 1.0, "surface_energy_joule_per_m2": 20.0}
    soil = soil_of({"kind": "elasto_plastic_adhesive", "particle": sticky, "boundary": sticky})
    small, large = (pair_values(one)[0] for one in (soil, scaled(soil, RATIO)))
    assert isinstance(small, ElastoPlasticAdhesivePair)
    assert isinstance(large, ElastoPlasticAdhesivePair)
    assert_allclose(large.pull_off / small.pull_off, RATIO**2)
    overlap_m = 1e-4
    pulls = [
        found.adhesion_root * math.sqrt(at) for found, at in ((small, overlap_m), (large, RATIO * overlap_m))
    ]
    assert_allclose(pulls[1] / pulls[0], RATIO**2)
