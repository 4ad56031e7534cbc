"""Dampers that follow from a restitution: of pairs, layers, walls and tools, and what is refused."""

import math
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from subsoil_ros.contact_laws.dampers import TANGENTIAL_DAMPING, restitution_at
from subsoil_ros.dem.packing.relaxation import smooth_soil
from subsoil_ros.errors import SceneError
from subsoil_ros.limits.soil_at_work import damping_ratio
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.scene.pair_laws import (
    layer_soils,
    pair_values,
    particle_mass_kg,
    particle_values,
    tool_values,
)
from subsoil_ros.scene.soil import Soil
from tests.soils import BOUNDARY, DRY, PARTICLE

SCENES = Path(__file__).parents[3] / "config" / "scenes"
E = 0.4


def by_restitution(row: dict[str, Any]) -> dict[str, Any]:
    """A row with E in place of its dampers."""
    return {key: value for key, value in row.items() if "damping" not in key} | {"restitution": E}


DRY_E, PARTICLE_E, BOUNDARY_E = map(by_restitution, (DRY, PARTICLE, BOUNDARY))
LAWS: dict[str, dict[str, Any]] = {
    "linear": {"kind": "linear", "particle": DRY_E, "boundary": DRY_E},
    "bodies in series": {"kind": "cohesive_linear", "particle": PARTICLE_E, "boundary": BOUNDARY_E},
    "pairs": {
        "kind": "cohesive_linear", "combining_rule": "none", "particle": PARTICLE_E, "boundary": BOUNDARY_E,
    },
}  # fmt: skip


def soil_under(law: dict[str, Any], **more: Any) -> Soil:
    """The tine's soil under another law."""
    soil = load_scene(SCENES / "tine.yaml").scene.particle_soil
    assert soil is not None
    return Soil.model_validate(soil.model_dump() | {"law": law} | more)


def restitution_of(values: Any, mass_kg: float) -> float:
    """Of spring and dashpot with this reduced mass."""
    return restitution_at(values.damping / (2.0 * math.sqrt(values.stiffness * mass_kg)))


@pytest.mark.parametrize("name", LAWS)
def test_pairs_walls_and_tools_have_the_restitution(name: str) -> None:
    """With the reduced mass m / 2 of a pair, m at walls and at tools of another stiffness; `check` agrees."""
    soil = soil_under(LAWS[name], tool_stiffness_factor=3.0)
    pair, wall = pair_values(soil)
    mass = particle_mass_kg(soil)
    for values, reduced in ((pair, 0.5 * mass), (wall, mass), (tool_values(soil), mass)):
        assert_allclose(restitution_of(values, reduced), E, rtol=1e-12)
        assert values.tangential_damping == TANGENTIAL_DAMPING * values.damping
    assert_allclose(restitution_at(damping_ratio(soil)), E, rtol=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_particles_of_another_size_have_it_too(name: str) -> None:
    """`reference_radius_m` scales the springs; the dampers follow."""
    soil = soil_under(LAWS[name])
    larger = {"radius_m": 0.017, "reference_radius_m": 0.01}
    changed = soil.model_copy(update={"particles": soil.particles.model_copy(update=larger)})
    assert_allclose(restitution_of(pair_values(changed)[0], 0.5 * particle_mass_kg(changed)), E, rtol=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_unlike_layers_have_the_smaller_one(name: str) -> None:
    """Whatever their stiffnesses."""
    kind = LAWS[name]["kind"]
    hard = {"kind": kind, "particle": {"restitution": 0.7, "stiffness_newton_per_m": 1e5}}
    layers = [{"name": "top", "thickness_m": 0.1}, {"name": "pan", "law": hard}]
    top, pan = layer_soils(soil_under(LAWS[name], layers=layers))
    assert_allclose(restitution_of(pair_values(pan)[0], 0.5 * particle_mass_kg(pan)), 0.7, rtol=1e-12)
    assert_allclose(restitution_of(particle_values(top, pan, 0.005, 1e-3), 1e-3), E, rtol=1e-12)


def test_a_bed_settles_under_a_damping_ratio_of_its_own() -> None:
    """Bouncier than the preparation wants it stays as it is; more strongly damped, the limit counts."""
    for given, expected in ((0.9, 0.9), (0.1, restitution_at(0.3))):
        row = DRY_E | {"restitution": given}
        smooth = smooth_soil(soil_under({"kind": "linear", "particle": row, "boundary": row}), adhesive=False)
        pair = pair_values(smooth)[0]
        assert_allclose(restitution_of(pair, 0.5 * particle_mass_kg(smooth)), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["particle.restitution=0.5"], "particle.damping_newton_s_per_m: given damping_newton_s_per_m and"),
        (["boundary.damping_newton_s_per_m=null"], "boundary.damping_newton_s_per_m: given tangential"),
        (
            [
                "particle.restitution=0.5",
                "particle.damping_newton_s_per_m=null",
                "particle.tangential_damping_newton_s_per_m=null",
            ],
            "soil.law.boundary.restitution: not given, while particle has one",
        ),
    ],
    ids=["both", "one damper", "rows of two forms"],
)  # fmt: skip
def test_both_or_neither_is_refused(changes: list[str], words: str) -> None:
    """Where, what is given, what is allowed and what to do."""
    with pytest.raises(SceneError) as refused:
        load_scene(SCENES / "tine.yaml", [f"soil.law.{change}" for change in changes])
    assert words in str(refused.value)
    assert "give" in str(refused.value)


def test_a_layer_keeps_the_form_of_the_law() -> None:
    """A restitution over dampers, and dampers over a restitution."""
    pan = "{name: pan, law: {kind: cohesive_linear, particle: {restitution: 0.5}}}"
    with pytest.raises(SceneError, match=r"layers\.1\.law\.particle\.restitution: given 0\.5, but soil\.law"):
        load_scene(SCENES / "tine.yaml", [f"soil.layers=[{{name: top, thickness_m: 0.1}}, {pan}]"])
    layers = [
        {"name": "top", "thickness_m": 0.1},
        {"name": "pan", "law": {"kind": "linear", "boundary": {"damping_newton_s_per_m": 3.0}}},
    ]
    with pytest.raises(ValueError, match=r"layers\.1\.law\.boundary\.damping_newton_s_per_m: given 3"):
        soil_under(LAWS["linear"], layers=layers)
