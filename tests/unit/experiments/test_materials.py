"""Soils by their laboratory values: what `soil.material` stands for, what is refused, and how the fit
searches."""

import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import yaml
from numpy.testing import assert_allclose

from subsoil_ros.cli.main import main
from subsoil_ros.dem.packing.bed_geometry import sample_edge_m
from subsoil_ros.errors import InputError, SceneError
from subsoil_ros.experiments import laboratory_fit as calibration
from subsoil_ros.experiments.particle_forms import FORMS
from subsoil_ros.loading.files import config_folder, shipped_names
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.loading.material_file import is_of, read_laboratory_soil, read_material, write_material
from subsoil_ros.scene.material import LaboratorySoil
from subsoil_ros.scene.pair_laws import pair_values

LABORATORY = {
    "model": "laboratory", "name": "test soil", "source": "made up", "cohesion_pa": 8e3,
    "friction_angle_deg": 31.0, "bulk_density_kg_per_m3": 1500.0, "metal_friction_angle_deg": 22.0,
}  # fmt: skip


def scene(**soil: Any) -> ResolvedScene:
    """A bin of loam; `soil` changes keys."""
    keys: dict[str, Any] = {
        "material": "loam",
        "bin": {"length_m": 0.6, "width_m": 0.4, "depth_m": 0.3},
        "particles": {"radius_m": 0.012},
    }
    found = {key: value for key, value in {**keys, **soil}.items() if value is not None}
    return load_scene({"name": "field", "duration_s": 1.0, "soil": found})


def test_a_material_is_its_particles_bed_and_law():
    """The scene is the one that has them written out, also when it is loaded from what a run records."""
    found = scene(bed={"seed": 3})
    material = found.material
    assert material is not None
    assert material.soil.cohesion_pa == 10e3
    assert "material" not in found.document["soil"]
    again = load_scene(found.document)
    assert again.scene_hash == found.scene_hash
    soil = found.scene.particle_soil
    assert soil is not None
    assert soil.bed.kind == "tiled"
    assert soil.bed.seed == 3
    assert soil.particles.bounds_m == pytest.approx((0.85 * 0.012, 1.15 * 0.012))
    ratio = soil.particles.mean_volume_radius_m / soil.particles.reference_radius_m
    assert_allclose(ratio, 0.012 / material.radius_m, rtol=1e-12)
    row = material.law["particle"]
    pair, boundary = pair_values(soil)
    assert_allclose(pair.stiffness, ratio * row["stiffness_newton_per_m"])
    assert_allclose(pair.peak_attraction, ratio**2 * material.fitted["attraction_newton"].value, rtol=1e-9)
    assert_allclose(
        math.degrees(math.atan(boundary.sliding_friction)), material.soil.metal_friction_angle_deg
    )


@pytest.mark.parametrize("name", shipped_names("materials"))
def test_shipped_materials_meet_their_soils(name):
    """Within what the calibration promises; each has the shipped soil that it was fitted to."""
    material = read_material(config_folder() / "materials" / f"{name}.yaml", name)
    soil = name.removesuffix("_bonded").removesuffix("_plastic")  # other laws
    assert material.soil == read_laboratory_soil(config_folder() / "soils" / f"{soil}.yaml")
    found = {key: interval.value for key, interval in material.measured.items()}
    assert abs(found["friction_angle_deg"] - material.soil.friction_angle_deg) < 0.5
    assert abs(found["cohesion_pa"] - material.soil.cohesion_pa) < max(
        300.0, 0.03 * material.soil.cohesion_pa
    )
    assert abs(found["bulk_density_kg_per_m3"] / material.soil.bulk_density_kg_per_m3 - 1.0) < 0.01
    if "tensile_strength_pa" in found:
        assert found["tensile_strength_pa"] < found["cohesion_pa"] / math.tan(
            math.radians(found["friction_angle_deg"])
        )


def test_a_scene_may_choose_and_change_its_material(tmp_path):
    """By --set: another radius is still the material's, another friction is not."""
    path = tmp_path / "scene.yaml"
    soil = {
        "material": "loam", "bin": {"length_m": 0.6, "width_m": 0.4, "depth_m": 0.3},
        "particles": {"radius_m": 0.012},
    }  # fmt: skip
    path.write_text(yaml.safe_dump({"name": "field", "duration_s": 1.0, "soil": soil}))
    coarse = load_scene(path, ["soil.particles.radius_m=0.02", "soil.bed.seed=5"])
    assert coarse.material is not None
    assert coarse.scene.particle_soil.particles.bounds_m[1] == pytest.approx(0.023)
    layers = "soil.layers=[{name: top, thickness_m: 0.1}, {name: bottom, density_kg_per_m3: 2000.0}]"
    others = (
        "soil.law.particle.static_friction=0.7", "soil.bed={kind: tiled, solid_fraction: 0.57}", layers,
        "soil.bed={kind: dense_random}", "soil.particles.density_kg_per_m3=2000.0",
    )  # fmt: skip
    for other in others:
        assert load_scene(path, [other]).material is None
    changed = load_scene(path, others[:1])
    assert changed.scene.particle_soil.law.particle.static_friction == 0.7
    soil["bed"] = {"solid_fraction": 0.57}
    path.write_text(yaml.safe_dump({"name": "field", "duration_s": 1.0, "soil": soil}))
    assert load_scene(path).material is None


def test_a_folder_of_the_name_and_no_material(tmp_path, monkeypatch):
    """A folder hides no shipped material; null is none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loam").mkdir()
    assert scene().material is not None
    with pytest.raises(SceneError, match=r"soil\.law: is missing"):
        load_scene({"name": "field", "duration_s": 1.0, "soil": {"material": None}})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"material": "mud"}, "soil.material: given 'mud'; there is no such file or shipped soil"),
        ({"material": 3}, "soil.material: given 3; it must be a material file or a soil's name"),
        ({"particles": {"radius_m": 0.03}}, r"given 0.03; it must be a mean radius from 0.005 to 0.02 m"),
        ({"particles": None}, "soil.particles.radius_m: is missing; give a mean radius"),
        ({"law": {"kind": "linear"}}, "soil.law: given beside soil.material, which brings it"),
        (
            {"particles": {"radius_m": 0.01, "density_kg_per_m3": 2000.0}},
            "soil.particles.density_kg_per_m3: given beside soil.material",
        ),
        ({"bed": {"tile_m": 2.0}}, "soil.bed.tile_m: 2 m given; allowed is at least .* and at most 0.4 m"),
    ],
)
def test_bad_materials_in_scenes(change, words):
    """One message each."""
    with pytest.raises(SceneError, match=words):
        sample_edge_m(scene(**change).scene.particle_soil)


def test_a_material_of_another_version(tmp_path):
    """Says which one this program reads."""
    material = read_material(config_folder() / "materials" / "loam.yaml", "loam")
    path = tmp_path / "old.yaml"
    write_material(path, material.model_copy(update={"version": 0}))
    with pytest.raises(SceneError, match="version 0, this program reads 1; calibrate the soil again"):
        scene(material=str(path))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tensile_strength_pa": 14e3}, r"no soil bears more tension than .* 1\.331e\+04 Pa"),
        ({"friction_angle_deg": 70.0}, "friction_angle_deg"),
        ({"critical_friction_angle_deg": 25.0}, "it is fitted without cohesion only"),
        ({"cohesion_pa": 0.0, "critical_friction_angle_deg": 40.0}, "at most friction_angle_deg, 31"),
        ({"cohesion": 3.0}, "unknown key 'cohesion'"),
        ({"source": None}, "source"),
    ],
)
def test_bad_soils_of_laboratories(tmp_path, capsys, change, words):
    """The command line says it in one message and writes nothing."""
    path, out = tmp_path / "soil.yaml", tmp_path / "out.yaml"
    document = {key: value for key, value in {**LABORATORY, **change}.items() if value is not None}
    path.write_text(yaml.safe_dump(document))
    assert main(["calibrate", str(path), "--radius", "0.01", "--out", str(out)]) != 0
    assert re.search(words, capsys.readouterr().err)
    assert not out.exists()


def test_radius_and_laboratory_belong_together(tmp_path, capsys):
    """A soil needs --radius, a design has none, and spheres are smaller than tools."""
    path, out = tmp_path / "soil.yaml", tmp_path / "out.yaml"
    path.write_text(yaml.safe_dump(LABORATORY))
    assert main(["calibrate", str(path), "--out", str(out)]) != 0
    assert "--radius: is needed for a laboratory's soil" in capsys.readouterr().err
    assert main(["calibrate", str(path), "--radius", "0.5", "--out", str(out)]) != 0
    assert "--radius: given 0.5 m, allowed is up to 0.1 m" in capsys.readouterr().err


class InProcess:
    """A Dask client without a cluster."""

    def map(self, function: Callable[..., Any], items: list[Any], *, pure: bool) -> list[Any]:
        return [function(item) for item in items]

    def gather(self, found: list[Any]) -> list[Any]:
        return found


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Tests of a soil whose strength is a formula, with a scatter by seed; counts the sets."""
    count = {"sets": 0}

    def strength(document: Any) -> tuple[float, float, float]:
        soil = document["soil"]
        row, seed = soil["law"]["particle"], soil["bed"]["seed"]
        count["sets"] += 1
        friction = row["static_friction"]
        attraction = row.get("cohesive_stiffness_newton_per_m", 0.0) * row.get("cohesion_range_m", 0.0)
        attraction += row.get("pull_off_newton", 0.0)
        attraction += 3e-4 * soil.get("bonds", {}).get("tensile_strength_pa", 0.0)
        off = 0.01 * ((seed % 3) - 1.0)
        angle = 45.0 * (1.0 - math.exp(-3.0 * friction)) + 0.2 * attraction
        return angle * (1.0 + off), 3e3 * attraction * (0.4 + friction) * (1.0 - off), 0.61 * 2500.0

    def peak_and_critical(document: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        angle, _, density = strength(document)
        rolling = document["soil"]["law"]["particle"]["rolling_friction"]
        return (angle + 20.0 * rolling, 0.0, density), (23.0 + 30.0 * rolling, 10.0, density)

    @contextmanager
    def connected(scheduler: str | None, workers: int) -> Iterator[tuple[InProcess, int]]:
        yield InProcess(), workers

    def modulus(document: Any) -> float:
        row = document["soil"]["law"]["particle"]
        return 30.0 * row.get("stiffness_newton_per_m", row.get("youngs_modulus_pa"))

    monkeypatch.setattr(calibration, "connected", connected)
    monkeypatch.setattr(calibration, "_strength", strength)
    monkeypatch.setattr(calibration, "_critical", strength)
    monkeypatch.setattr(calibration, "_peak_and_critical", peak_and_critical)
    monkeypatch.setattr(calibration, "_modulus", modulus)
    monkeypatch.setattr(calibration, "_tension", lambda document: 1e3)
    monkeypatch.setattr(calibration, "_pressed", lambda document: None)
    return count


def fit(law: str = "cohesive_linear", **changes: Any) -> Any:
    """A calibration to the made-up tests."""
    soil = LaboratorySoil.model_validate({**LABORATORY, **changes})
    return calibration.calibrate(soil, 0.01, 1, lambda text: None, law)


def test_the_fit_finds_friction_and_attraction(made_up):
    """Both targets are met, dampers have the restitution, density is corrected, and a file gives it back."""
    material = fit()
    found = material.measured
    assert abs(found["friction_angle_deg"].value - 31.0) < 0.3
    assert abs(found["cohesion_pa"].value - 8e3) < 0.02 * 8e3
    assert found["cohesion_pa"].low < found["cohesion_pa"].value < found["cohesion_pa"].high
    assert made_up["sets"] <= 9 * 4
    row = material.law["particle"]
    assert row["sliding_friction"] == material.fitted["static_friction"].value
    assert_allclose(
        row["stiffness_newton_per_m"] * row["equilibrium_overlap_m"],
        material.fitted["attraction_newton"].value,
    )
    mass = material.density_kg_per_m3 * 4.0 / 3.0 * math.pi * calibration.mean_volume_radius_m(0.01) ** 3
    ratio = row["damping_newton_s_per_m"] / (2.0 * math.sqrt(0.5 * mass * row["stiffness_newton_per_m"]))
    assert_allclose(math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2)), 0.6, rtol=1e-9)
    assert_allclose(material.density_kg_per_m3, 2500.0 * 1500.0 / (0.61 * 2500.0))


@pytest.mark.parametrize("law", ["elasto_plastic_adhesive", "bonded"])
def test_other_laws_are_fitted_likewise(made_up, law, tmp_path):
    """Their own number makes the cohesion, a file gives it back, and a scene takes the particles."""
    material = fit(law)
    assert abs(material.measured["cohesion_pa"].value - 8e3) < 0.02 * 8e3
    assert set(material.fitted) == {"static_friction", FORMS[law].fitted}
    path = tmp_path / "made.yaml"
    write_material(path, material)
    soil = scene(material=str(path)).scene.particle_soil
    assert is_of(soil, material)
    radius = soil.particles.mean_volume_radius_m
    pair = pair_values(soil)[0]
    at_work = 4.0 * calibration.WORKING_STRESS_PA * radius / calibration.MAX_OVERLAP
    assert pair.stiffness == pytest.approx(at_work, rel=1e-6)
    if law == "bonded":
        assert soil.bonds.tensile_strength_pa == material.fitted["bond_tensile_strength_pa"].value
        assert pair.peak_attraction == 0.0
        weaker = soil.bonds.model_copy(update={"tensile_strength_pa": 1e3})
        assert not is_of(soil.model_copy(update={"bonds": weaker}), material)
        with pytest.raises(SceneError, match=r"soil\.bonds: given beside soil\.material"):
            scene(material=str(path), bonds=material.bonds)


def test_bonds_need_a_cohesion(made_up):
    """Dry soil has nothing for them to bear."""
    with pytest.raises(InputError, match=r"--law bonded: soil 'test soil' has cohesion_pa 0"):
        fit("bonded", cohesion_pa=0.0)
    assert fit("elasto_plastic_adhesive", cohesion_pa=0.0).law["kind"] == "elasto_plastic_adhesive"


def test_dry_soil_has_no_attraction(made_up):
    """One number is left to find."""
    material = fit(cohesion_pa=0.0)
    assert material.law["kind"] == "linear"
    assert set(material.fitted) == {"static_friction"}
    assert "tensile_strength_pa" not in material.measured


def test_the_critical_angle_of_a_dry_soil_is_met_by_rolling_friction(made_up, tmp_path):
    """Both angles, in a file that gives both frictions back."""
    wanted = {"cohesion_pa": 0.0, "friction_angle_deg": 36.0, "critical_friction_angle_deg": 31.0}
    material = fit(**wanted)
    assert abs(material.measured["friction_angle_deg"].value - 36.0) < 0.3
    assert abs(material.measured["critical_friction_angle_deg"].value - 31.0) < 0.3
    assert set(material.fitted) == {"static_friction", "rolling_friction"}
    rolling = material.fitted["rolling_friction"].value
    assert material.law["particle"]["rolling_friction"] == rolling == pytest.approx(8.0 / 30.0, abs=0.01)
    path = tmp_path / "made.yaml"
    write_material(path, material)
    assert read_material(path, "made") == material


def test_what_cannot_be_reached(made_up):
    """A friction angle that no friction gives, and a modulus too soft for the overlap at work."""
    with pytest.raises(InputError, match=r"spheres of this .* reach .* to 4\d\.\d degrees"):
        fit(friction_angle_deg=55.0)
    with pytest.raises(InputError, match=r"confined_modulus_pa: given 1000 Pa; it must be .* Pa or more"):
        fit(confined_modulus_pa=1000.0)


def test_stiffness_from_the_confined_modulus(made_up):
    """A stiffer soil has stiffer contacts, in proportion."""
    dry = fit(confined_modulus_pa=5e6, cohesion_pa=0.0).measured
    assert_allclose(dry["confined_modulus_pa"].value, 5e6, rtol=1e-9)
    for wanted in (4e6, 6e6):  # attraction has a say in the first
        found = fit(confined_modulus_pa=wanted, cohesion_pa=30e3).measured
        assert_allclose(found["confined_modulus_pa"].value, wanted, rtol=0.05)
        assert_allclose(found["cohesion_pa"].value, 30e3, rtol=0.02)
