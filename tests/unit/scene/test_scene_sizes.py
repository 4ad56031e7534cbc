"""Sizes and layers in a scene: sampled radii, laws of unlike pairs, step limits, and what is refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from pydantic import ValidationError
from scipy.stats import truncnorm

from subsoil_ros.contact_laws.base import ContactLaw, layer_law
from subsoil_ros.contact_laws.cohesive_linear.law import CohesiveLinearLaw
from subsoil_ros.contact_laws.hertz.law import HertzMindlinLaw
from subsoil_ros.contact_laws.linear.law import LinearLaw
from subsoil_ros.contact_laws.registry import contact_laws
from subsoil_ros.errors import SceneError
from subsoil_ros.limits.stable_steps import step_limits
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.scene.pair_laws import layer_soils, pair_values, particle_values
from subsoil_ros.scene.sizes import ListedSizes, NormalSizes, UniformSizes, mean_power, sampled_radii_m
from subsoil_ros.scene.soil import Soil

SCENES = Path(__file__).parents[3] / "config" / "scenes"
COUNT = 20_000


def test_uniform_radii_have_their_mean_and_deviation() -> None:
    """(a + b) / 2 and (b - a) / sqrt(12), within three standard errors of the sample."""
    sizes = UniformSizes(kind="uniform", min_radius_m=0.006, max_radius_m=0.012, seed=1)
    radii = sampled_radii_m(sizes, COUNT)
    deviation = 0.006 / np.sqrt(12.0)
    assert radii.min() >= 0.006
    assert radii.max() <= 0.012
    assert abs(radii.mean() - 0.009) < 3.0 * deviation / np.sqrt(COUNT)
    # the fourth central moment is 1.8 deviation^4
    assert abs(radii.var() - deviation**2) < 3.0 * deviation**2 * np.sqrt(0.8 / COUNT)
    assert_allclose(mean_power(sizes, 3), (0.012**4 - 0.006**4) / (4.0 * 0.006), rtol=1e-6)


def test_normal_radii_are_cut_at_the_bounds() -> None:
    """Mean and deviation of the cut normal distribution, within three standard errors; none outside."""
    sizes = NormalSizes(
        kind="normal", mean_radius_m=0.009, standard_deviation_m=0.002,
        min_radius_m=0.007, max_radius_m=0.0125, seed=2,
    )  # fmt: skip
    law = truncnorm(-1.0, 1.75, loc=0.009, scale=0.002)
    radii = sampled_radii_m(sizes, COUNT)
    assert radii.min() >= 0.007
    assert radii.max() <= 0.0125
    assert abs(radii.mean() - law.mean()) < 3.0 * law.std() / np.sqrt(COUNT)
    assert_allclose(radii.std(), law.std(), rtol=3.0 / np.sqrt(2.0 * COUNT))  # flatter than a normal one
    assert_allclose(mean_power(sizes, 3), law.moment(3), rtol=1e-5)


@pytest.mark.parametrize("shares_are", ["number", "mass"])
def test_listed_radii_have_their_shares(shares_are: str) -> None:
    """By number or by mass as said, each frequency within three standard errors."""
    radii_m, shares = np.array([0.006, 0.009, 0.015]), np.array([1.0, 2.0, 5.0])
    sizes = ListedSizes(
        kind="listed", radii_m=tuple(radii_m), shares=tuple(shares), shares_are=shares_are, seed=3
    )  # fmt: skip
    part = shares if shares_are == "number" else shares / radii_m**3
    part = part / part.sum()
    found = sampled_radii_m(sizes, COUNT)
    frequency = np.array([(found == radius).mean() for radius in radii_m])
    assert (np.abs(frequency - part) < 3.0 * np.sqrt(part * (1.0 - part) / COUNT)).all()


def test_the_seed_chooses_the_sample() -> None:
    """The same seed gives the same radii, another one others."""
    sizes = UniformSizes(kind="uniform", min_radius_m=0.006, max_radius_m=0.012, seed=1)
    assert (sampled_radii_m(sizes, 50) == sampled_radii_m(sizes, 50)).all()
    assert (sampled_radii_m(sizes, 50) != sampled_radii_m(sizes.model_copy(update={"seed": 2}), 50)).all()


Make = Callable[..., ResolvedScene]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Loads tine.yaml with other keys in its soil."""

    def load(**changes: Any) -> ResolvedScene:
        document: dict[str, Any] = yaml.safe_load((SCENES / "tine.yaml").read_text())
        del document["tools"]
        document["soil"].update(changes)
        path = tmp_path / "scene.yaml"
        path.write_text(yaml.safe_dump(document))
        return load_scene(path)

    return load


def soil_of(make: Make, **changes: Any) -> Soil:
    """The soil of a changed tine.yaml."""
    soil = make(**changes).scene.soil
    assert soil is not None
    return soil


HARD = {
    "name": "hardpan",
    "density_kg_per_m3": 2000.0,
    "law": {"kind": "cohesive_linear", "particle": {
            "stiffness_newton_per_m": 3e4, "damping_newton_s_per_m": 60.0,
            "tangential_damping_newton_s_per_m": 60.0, "static_friction": 0.7,
            "sliding_friction": 0.2, "equilibrium_overlap_m": 0.001, "cohesion_range_m": 0.003}},
}  # fmt: skip
TOP = {"name": "topsoil", "thickness_m": 0.1}
DENSE = {"kind": "dense_random"}
UNIFORM = {"kind": "uniform", "min_radius_m": 0.008, "max_radius_m": 0.012}


def test_layers_take_what_they_do_not_give_from_the_soil(make: Make) -> None:
    """Rows are merged value by value."""
    top, hard = layer_soils(soil_of(make, layers=[TOP, HARD], bed=DENSE))
    assert top.law == soil_of(make).law
    assert (top.particles.density_kg_per_m3, hard.particles.density_kg_per_m3) == (1800.0, 2000.0)
    assert hard.law.particle.stiffness_newton_per_m == 3e4
    assert hard.law.particle.cohesive_stiffness_newton_per_m == 7e3
    assert hard.law.boundary == top.law.boundary


@pytest.mark.parametrize("law", [CohesiveLinearLaw, LinearLaw, HertzMindlinLaw])
def test_a_layer_may_change_every_value_of_a_row(law: type[ContactLaw]) -> None:
    """The keys are those of the law's rows, with the same bounds."""
    change, row = (model.model_fields["particle"].annotation for model in (layer_law(law), law))
    assert change.model_fields.keys() == row.model_fields.keys()
    assert set(change().model_dump().values()) == {None}
    for key in row.model_fields:
        with pytest.raises(ValidationError, match="greater than"):
            change.model_validate({key: -2.0})


def test_no_two_laws_have_numbers_of_one_name() -> None:
    """numba tells compiled functions apart by the names of the classes of their arguments."""
    names = [law.numbers.__name__ for law in contact_laws().values()]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(("rule", "factor"), [("series", 1.0), ("none", 2.0)])
def test_unlike_pairs(make: Make, rule: str, factor: float) -> None:
    """Springs, dampers and adhesion in series (eq. 15, 16, 18), twice that for values of pairs; the smaller
    friction; mean rest overlap and reach; K_C follows (eq. 20). The order does not matter."""
    law = soil_of(make).law.model_dump() | {"combining_rule": rule}
    top, hard = layer_soils(soil_of(make, layers=[TOP, HARD], bed=DENSE, law=law))
    found = particle_values(top, hard, 0.005, 0.004)
    assert_allclose(found.stiffness, factor * 1e4 * 3e4 / 4e4)
    assert_allclose(found.damping, factor * 20.0 * 60.0 / 80.0)
    assert_allclose(found.adhesion, factor * 7e3 / 2.0)
    assert (found.static_friction, found.sliding_friction) == (0.5, 0.2)
    assert_allclose((found.rest_overlap, found.reach), (0.0015, 0.0025))
    assert_allclose(found.contact_adhesion, found.adhesion * 0.0025 / 0.0015)
    assert found == particle_values(hard, top, 0.005, 0.004)
    assert_allclose(pair_values(top)[0].stiffness, factor * 1e4 / 2.0)


def test_unlike_pairs_of_dry_laws(make: Make) -> None:
    """Linear: harmonic means, the pair's own where both are alike. Hertz: 1 / E* = sum of (1 - nu^2) / E."""
    row = {
        "stiffness_newton_per_m": 1e5, "tangential_stiffness_newton_per_m": 8e4,
        "damping_newton_s_per_m": 5.0, "tangential_damping_newton_s_per_m": 5.0,
        "static_friction": 0.5, "sliding_friction": 0.4,
    }  # fmt: skip
    linear = {"kind": "linear", "particle": row, "boundary": row}
    hard = {"name": "hard", "law": {"kind": "linear", "particle": {"stiffness_newton_per_m": 3e5}}}
    top, below = layer_soils(soil_of(make, layers=[TOP, hard], bed=DENSE, law=linear))
    found = particle_values(top, below, 0.005, 0.004)
    assert_allclose((found.stiffness, found.tangential_stiffness), (2.0 / (1.0 / 1e5 + 1.0 / 3e5), 8e4))
    row = {
        "youngs_modulus_pa": 1e7, "poisson_ratio": 0.25, "restitution": 0.5,
        "static_friction": 0.5, "sliding_friction": 0.4,
    }  # fmt: skip
    hertz = {"kind": "hertz_mindlin", "particle": row, "boundary": row}
    hard = {"name": "hard", "law": {"kind": "hertz_mindlin", "particle": {"youngs_modulus_pa": 4e7}}}
    top, below = layer_soils(soil_of(make, layers=[TOP, hard], law=hertz))
    modulus = 1.0 / ((1.0 - 0.25**2) * (1.0 / 1e7 + 1.0 / 4e7))
    found = particle_values(top, below, 0.005, 0.004)
    assert_allclose(found.stiffness, 4.0 / 3.0 * modulus * np.sqrt(0.005))


def test_step_limit_takes_the_lightest_particle_and_the_stiffest_damper(make: Make) -> None:
    """0.6 (r / l)^2 m / (z C) with the smallest radius, that layer's which is worst."""

    def spin(radius: float, density: float, damping: float, rest_overlap: float) -> float:
        mass, arm = density * 4.0 / 3.0 * np.pi * radius**3, radius - 0.5 * rest_overlap
        return 0.6 * (radius / arm) ** 2 * mass / (10.4 * damping)

    particles = {"sizes": UNIFORM, "density_kg_per_m3": 1800.0}
    limits = step_limits(soil_of(make, particles=particles, bed=DENSE))
    assert_allclose(limits[0].limit_s, spin(0.008, 1800.0, 10.0, 0.002), rtol=1e-12)
    limits = step_limits(soil_of(make, particles=particles, bed=DENSE, layers=[TOP, HARD]))
    worst = min(spin(0.008, 1800.0, 15.0, 0.0015), spin(0.008, 2000.0, 30.0, 0.001))
    assert_allclose(limits[0].limit_s, worst, rtol=1e-12)
    assert "layer hardpan" in limits[0].cause
    soft = {**HARD, "density_kg_per_m3": 500.0}
    limits = step_limits(soil_of(make, bed=DENSE, layers=[TOP, soft]))
    assert_allclose(limits[0].limit_s, spin(0.01, 500.0, 30.0, 0.001), rtol=1e-12)


LISTED = {"kind": "listed", "radii_m": [0.008, 0.01], "shares": [1.0, 1.0], "shares_are": "number"}
NORMAL = UNIFORM | {"kind": "normal", "mean_radius_m": 0.01, "standard_deviation_m": 0.001}


def sized(sizes: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Soil keys of a dense bed with these sizes, some of their keys changed."""
    return {"particles": {"sizes": sizes | changes, "density_kg_per_m3": 1800.0}, "bed": DENSE}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"particles": {"density_kg_per_m3": 1800.0}}, "particles.radius_m: neither is given; give"),
        (
            {"particles": {"density_kg_per_m3": 1800.0, "radius_m": 0.01, "sizes": UNIFORM}},
            "particles.radius_m: both are given",
        ),
        (sized(UNIFORM, min_radius_m=0.0), "min_radius_m: given 0.0; it must be a number greater"),
        (sized(UNIFORM, min_radius_m=0.012), "sizes.max_radius_m: 0.012 m is not above"),
        (sized(UNIFORM, max_radius_m=0.04), "sizes.max_radius_m: 0.04 m is 5 times .* up to 4 times"),
        (sized(NORMAL, mean_radius_m=0.013), "sizes.mean_radius_m: 0.013 m is not between"),
        (sized(NORMAL, standard_deviation_m=-1.0), "standard_deviation_m: given -1.0"),
        (sized(LISTED, shares=[1.0]), "sizes.shares: given a list of 1; it must be a list of at least 2"),
        (sized(LISTED, shares=[1.0, 1.0, 1.0]), "sizes.shares: has 3 entries for the 2 of radii_m"),
        (sized(LISTED, shares=[1.0, 0.0]), "sizes.shares.1: given 0.0; it must be a number greater than 0"),
        (sized(LISTED, radii_m=[0.01, 0.008]), "sizes.radii_m: must grow"),
        (sized(LISTED, radii_m=[0.001, 0.008]), "sizes.radii_m: 0.008 m is 8 times"),
        (sized(LISTED, shares_are="volume"), "sizes.shares_are: given the text 'volume'"),
        (sized(UNIFORM, mean_m=0.01), "sizes.mean_m: unknown key 'mean_m'"),
        (sized(UNIFORM) | {"bed": {"kind": "grid", "spacing_m": 0.018}}, "bed.kind: 'grid' has one spacing"),
        (
            sized(UNIFORM, min_radius_m=0.0019, max_radius_m=0.007),
            "equilibrium_overlap_m: 0.002 m is not",
        ),
        ({"layers": [HARD]}, "soil.layers: given a list of 1; it must be a list of at least 2 entries"),
        ({"layers": [HARD, TOP]}, "layers.0.thickness_m: is missing"),
        ({"layers": [TOP, HARD | {"thickness_m": 0.1}]}, "layers.1.thickness_m: the last layer goes on"),
        ({"layers": [TOP | {"thickness_m": 0.01}, HARD]}, "layers.0.thickness_m: 0.01 m is less than a part"),
        ({"layers": [TOP | {"thickness_m": 0.27}, HARD]}, "layers.0.thickness_m: .* leave nothing"),
        ({"layers": [TOP, HARD | {"name": "topsoil"}]}, "layers.1.name: 'topsoil' is the name of a layer"),
        (
            {"layers": [TOP, {"name": "hard", "law": {"kind": "linear"}}]},
            "layers.1.law.kind: 'linear' differs from soil.law.kind, 'cohesive_linear'",
        ),
        (
            {"layers": [TOP, HARD]},
            "layers.1.law: has another equilibrium_overlap_m than soil.law, but a grid",
        ),
        (
            {"layers": [TOP, HARD | {"colour": "red"}]},
            "layers.1.colour: unknown key 'colour'; known here are",
        ),
        (
            {
                "layers": [
                    TOP,
                    HARD | {"law": {"kind": "cohesive_linear", "particle": {"cohesoin_range_m": 0.1}}},
                ]
            },
            "layers.1.law.particle.cohesoin_range_m: unknown key 'cohesoin_range_m'; did you mean "
            "'cohesion_range_m'",
        ),
    ],
)
def test_what_cannot_be_is_refused(make: Make, changes: dict[str, Any], message: str) -> None:
    """By key path, with what was given and what is allowed."""
    with pytest.raises(SceneError, match=message):
        make(**changes)
