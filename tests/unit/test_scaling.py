"""Larger particles for the same soil: every number without dimension is kept."""

from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from subsoil_ros.errors import InputError
from subsoil_ros.scene.limits import step_limits
from subsoil_ros.scene.loader import load_scene
from subsoil_ros.scene.pairs import pair_values, particle_mass_kg
from subsoil_ros.scene.scaling import dimensionless, scaled_soil
from subsoil_ros.scene.soil import Soil

SCENES = Path(__file__).parents[2] / "config" / "scenes"
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
}


@pytest.mark.parametrize("name", LAWS)
def test_every_number_without_dimension_is_kept(name: str) -> None:
    """Both pairs, for each law, to round-off; unscaled, the same numbers differ (but for Hertz)."""
    soil = soil_of(LAWS[name])
    larger = scaled_soil(soil, RATIO * soil.particles.radius_m)
    unscaled = larger.model_copy(
        update={"particles": larger.particles.model_copy(update={"law_radius_m": None})}
    )

    def numbers(of: Soil, which: int) -> list[float]:
        values = pair_values(of)[which]
        found = dimensionless(values, 2.0 * of.particles.radius_m, of.particles.density_kg_per_m3, STRESS_PA)
        assert len(found) == 11
        return list(found.values())

    for which in (0, 1):
        assert_allclose(numbers(larger, which), numbers(soil, which), rtol=1e-12)
        changed = abs(numbers(unscaled, which)[0] / numbers(soil, which)[0] - 1.0)
        assert changed < 1e-12 if name == "hertz_mindlin" else changed > 0.1


def test_lengths_and_times_grow_with_the_radius() -> None:
    """Distances of the law, the grid, the skin and the stable step ~ s; forces ~ s^2, mass ~ s^3."""
    soil = soil_of(None).model_copy(update={"time_step_s": 4e-5, "largest_tool_overlap_m": 0.01})
    larger = scaled_soil(soil, RATIO * soil.particles.radius_m)
    pair, wide = pair_values(soil)[0], pair_values(larger)[0]
    assert_allclose([wide.rest_overlap / pair.rest_overlap, wide.reach / pair.reach], RATIO, rtol=1e-12)
    assert_allclose(wide.peak_attraction / pair.peak_attraction, RATIO**2, rtol=1e-12)
    assert_allclose(particle_mass_kg(larger) / particle_mass_kg(soil), RATIO**3, rtol=1e-12)
    assert_allclose(larger.bed.spacing_m / soil.bed.spacing_m, RATIO, rtol=1e-12)  # type: ignore[union-attr, operator]
    assert_allclose(larger.skin_m / soil.skin_m, RATIO, rtol=1e-12)
    assert_allclose(larger.time_step_s, RATIO * 4e-5, rtol=1e-12)
    assert_allclose(larger.largest_tool_overlap_m, RATIO * 0.01, rtol=1e-12)
    for old, new in zip(step_limits(soil), step_limits(larger), strict=True):
        assert_allclose(new.limit_s / old.limit_s, RATIO, rtol=1e-12)


def test_scaling_twice_is_scaling_once() -> None:
    """The law keeps the radius it was found for."""
    soil = soil_of(None)
    twice = scaled_soil(scaled_soil(soil, 0.015), 0.02)
    assert pair_values(twice) == pair_values(scaled_soil(soil, 0.02))
    assert pair_values(scaled_soil(scaled_soil(soil, 0.015), 0.01))[0] == pair_values(soil)[0]


def test_a_scene_asks_for_it_by_the_radius_of_the_law() -> None:
    """particles.law_radius_m scales the law of a scene, as `scaled_soil` does."""
    given = ["soil.particles.radius_m=0.015", "soil.particles.law_radius_m=0.01", "soil.bed.spacing_m=rest"]
    scene = load_scene(SCENES / "tine.yaml", given).scene
    assert scene.soil is not None
    assert pair_values(scene.soil) == pair_values(scaled_soil(soil_of(None), 0.015))


def test_a_saved_bed_is_refused() -> None:
    """Its particles have their size."""
    soil = soil_of(None)
    saved = Soil.model_validate(soil.model_dump() | {"bed": {"kind": "saved", "file": "bed.npz"}})
    with pytest.raises(InputError, match=r"soil\.bed\.kind: a saved bed keeps its radius 0\.01 m"):
        scaled_soil(saved, 0.02)
