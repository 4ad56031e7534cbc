"""Accuracy presets of scenes whose soil is a material: what they change, and where they are refused."""

import math
from pathlib import Path

import pandas as pd
import pytest
import trimesh
import yaml

from subsoil_ros.errors import SceneError
from subsoil_ros.loading.files import shipped_material
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.loading.presets import OF_MATERIALS


def radius_mm(resolved: ResolvedScene) -> float:
    """Mean radius of the particles."""
    soil = resolved.scene.particle_soil
    assert soil is not None
    low, high = soil.particles.bounds_m
    return 500.0 * (low + high)


@pytest.mark.parametrize(
    ("scene", "preset", "radius"),
    [
        # 0.20 m deep, share 0.06 m wide: 10, 20/3 and 5 diameters in the depth
        ("field_tine", "fine", 10.0),
        ("field_tine", "standard", 15.0),
        ("field_tine", "coarse", 20.0),
        # 0.30 m deep: 22.5 mm would be more than a third of the share
        ("field_1s300", "fine", 15.0),
        ("field_1s300", "standard", 20.0),
    ],
)
def test_size_follows_from_depth_and_width_of_the_tools(scene, preset, radius):
    """So many diameters in the depth, and at least one and a half across the share; the bed stays."""
    found, written = load_scene(scene, {"preset": preset}), load_scene(scene)
    assert radius_mm(found) == pytest.approx(radius)
    assert found.scene.particle_soil.bin == written.scene.particle_soil.bin
    assert found.preset == preset


def setback_mm(resolved: ResolvedScene) -> float:
    return 1e3 * resolved.scene.tools["tine"].setback_m


@pytest.mark.parametrize(
    ("preset", "changes", "expected"),
    [
        ("fine", {}, 5.0),
        ("standard", {}, 10.0),
        ("coarse", {}, 13.33),
        # a radius that is set counts, by whatever key; a seed is none
        ("coarse", {"soil.particles.radius_m": 0.014}, 9.33),
        ("standard", {"soil": {"particles": {"radius_m": 0.018}}}, 12.0),
        ("fine", {"soil.particles.radius_m": 0.014}, 7.0),
        ("coarse", {"soil.particles.sizes.seed": 3}, 13.33),
        # a setback that is set wins, and counts for the particles of the preset
        ("coarse", {"tools.tine.setback_m": 0.010}, 10.0),
        ("standard", {"tools.tine.setback_m": 0.0}, 0.0),
    ],
)
def test_tools_are_set_back_by_a_part_of_the_radius(preset, changes, expected):
    """By a half, and by two thirds."""
    found = load_scene("field_tine", {"preset": preset, **changes})
    assert setback_mm(found) == pytest.approx(expected)
    assert found.scene.particle_soil.surface is None


def test_depth_is_below_the_surface_of_the_scene():
    """A tine 0.20 m below z = 0 is 0.14 m deep under a surface at -0.06 m; the wedge model has none such."""
    low = {"soil.surface": {"x_m": [0.0], "z_m": [-0.06]}}
    assert radius_mm(load_scene("field_tine", {"preset": "fine", **low})) == pytest.approx(7.0)
    slope = {"soil.surface": {"x_m": [-0.05, 0.0], "z_m": [-0.06, 0.0]}}  # the tip begins at x = -0.05 m
    assert radius_mm(load_scene("field_tine", {"preset": "fine", **slope})) == pytest.approx(7.0)
    document = {
        "base": str(load_scene("field_tine").path),
        "name": "low",
        "soil": {"surface": low["soil.surface"]},
    }
    with pytest.raises(SceneError, match=r"preset real_time: the wedge model has its surface at z = 0"):
        load_scene(document, {"preset": "real_time"})


def test_a_step_is_one_for_the_particles_of_the_preset():
    """0.12 ms is too long for the particles of the scene as written, of 12.5 mm, and not for 20 mm."""
    step = {"soil.time_step_s": 1.2e-4, "coupling.communication_step_ns": 480_000}
    with pytest.raises(SceneError, match="above the stable limit"):
        load_scene("field_tine", step)
    assert radius_mm(load_scene("field_tine", {"preset": "coarse", **step})) == pytest.approx(20.0)
    beyond = step | {"soil.time_step_s": 2.4e-4, "allow": ["unstable_time_step"]}
    assert radius_mm(load_scene("field_tine", {"preset": "coarse", **beyond})) == pytest.approx(20.0)


def test_walls_are_said_to_change_the_errors():
    """They were measured in a field with held sides."""
    walls = {"soil.bin.sides": "walls", "soil.window": None, "soil.bin.length_m": 2.0}
    for changes, expected in (({}, False), (walls, True)):
        found = load_scene("field_tine", changes).presets["coarse"].expected
        assert any("in a bin with walls" in note for note in found.notes) == expected


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"preset": "nonsense"}, r"no preset 'nonsense'; .*fine"),
        ({"preset": "coarse", "soil.bed.solid_fraction": 0.58}, "another law, density, bed, layers or bonds"),
    ],
)
def test_a_preset_that_does_not_fit_says_why(changes, words):
    with pytest.raises(SceneError, match=words):
        load_scene("field_tine", changes)


@pytest.mark.parametrize("given_mm", [4.0, 0.0])
def test_a_setback_of_the_scene_stays(tmp_path, given_mm):
    """With particles; the wedge model has no use for it."""
    file, base = tmp_path / "scene.yaml", str(load_scene("field_tine").path)
    own = {"base": base, "name": "own", "tools": {"tine": {"setback_m": 1e-3 * given_mm}}}
    file.write_text(yaml.safe_dump(own))
    for preset, expected in (("coarse", given_mm), ("fine", given_mm), ("real_time", 0.0)):
        assert setback_mm(load_scene(file, {"preset": preset})) == pytest.approx(expected)


def test_a_wheel_is_not_set_back(tmp_path):
    """It would sink."""
    base = load_scene("field_tine")
    tine = base.scene.tools["tine"]
    path = {"start_x_m": -0.17, "start_z_m": 0.30, "speed_x_m_per_s": {"kind": "constant", "value": 0.5}}
    wheel = {"role": "wheel", "path": path, "groups": {"rim": {"mesh": tine.groups["share"].mesh}}}
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump({"base": str(base.path), "name": "own", "tools": {"wheel": wheel}}))
    found = load_scene(file, {"preset": "coarse"})
    assert radius_mm(found) == pytest.approx(20.0)
    assert setback_mm(found) == pytest.approx(13.33)
    assert found.scene.tools["wheel"].setback_m == 0.0


def test_width_is_that_in_the_soil_across_the_way(tmp_path):
    """A beam above the surface is no part of it; a thin plate that stands across is as wide as it is long."""
    boxes = {"bar": (0.02, 0.03, 0.5), "plate": (0.12, 0.03, 0.5), "beam": (0.02, 0.6, 0.1)}
    for name, size in boxes.items():
        box = trimesh.creation.box(size)
        box.apply_translation((0.0, 0.0, 0.5 * size[2] + (0.4 if name == "beam" else 0.0)))
        box.export(tmp_path / f"{name}.stl")

    def coarse_mm(*groups, **path):
        parts = {name: {"mesh": str(tmp_path / f"{name}.stl")} for name in groups}
        bar = {
            "path": {"start_x_m": -0.05, "start_z_m": -0.2, "speed_x_m_per_s": 0.5, **path},
            "groups": parts,
        }
        document = {"base": str(load_scene("field_tine").path), "report": {"tip_m": None}}
        return radius_mm(load_scene({**document, "tools": {"tine": None, "bar": bar}}, {"preset": "coarse"}))

    assert coarse_mm("bar") == coarse_mm("bar", "beam") == pytest.approx(10.0)
    assert coarse_mm("plate") == pytest.approx(10.0)
    across = {"start_rotation_rad": [0.0, 0.0, 0.5 * math.pi]}
    assert coarse_mm("plate", turn=across) == pytest.approx(20.0)


def test_depth_is_that_of_the_scene_as_changed():
    """A tine 0.10 m deep: 5 mm fits ten diameters."""
    found = load_scene("field_tine", {"preset": "fine", "tools.tine.path.start_z_m": 0.20})
    assert radius_mm(found) == pytest.approx(5.0)


def test_a_key_that_is_set_wins():
    """Overrides come after the preset."""
    found = load_scene("field_tine", {"preset": "fine", "soil.particles.radius_m": 0.018})
    assert radius_mm(found) == pytest.approx(18.0)


def test_radius_stays_in_the_range_of_the_material():
    """Ten diameters in 0.05 m would be 2.5 mm; the material begins at 5 mm."""
    found = load_scene("field_tine", {"preset": "fine", "tools.tine.path.start_z_m": 0.25})
    assert radius_mm(found) == pytest.approx(5.0)


def test_real_time_is_the_wedge_model_of_the_material(tmp_path):
    """Its file takes the place of the particles; refused are materials without one, among them loam under
    other laws and a copy of the file, which may have been changed."""
    found = load_scene("field_tine", {"preset": "real_time"})
    assert found.scene.wedge_soil is not None
    assert load_scene("field_swing", {"preset": "real_time"}).timing.communication_step_ns == 2_000_000
    copy = tmp_path / "loam.yaml"
    copy.write_bytes(shipped_material(Path("loam")).read_bytes())
    bonded = load_scene("field_tine", {"preset": "real_time", "soil.material": "loam_bonded"})
    assert Path(bonded.scene.wedge_soil.file).name == "loam_bonded_wedge.yaml"
    for material in ("clay_loam", "loam_plastic", str(copy)):
        with pytest.raises(SceneError, match=r"no wedge model comes with material .*; choose one of fine"):
            load_scene("field_tine", {"preset": "real_time", "soil.material": material})
        assert load_scene("field_tine", {"preset": "coarse", "soil.material": material}).preset == "coarse"


def test_the_step_of_real_time_follows_from_the_speed_of_a_path():
    """5 mm of travel at most, of rows of 10 ms as with the particles. A sine, whose largest speed is not
    derived, counts as 4 m/s."""
    speed_law = "tools.tine.path.speed_x_m_per_s"
    for speed, step_ns, ticks in ((0.5, 10_000_000, 1), (0.6, 5_000_000, 2), (4.0, 1_250_000, 8)):
        sped = load_scene("field_tine", {"preset": "real_time", f"{speed_law}.value": speed})
        assert sped.timing.communication_step_ns == step_ns
        assert sped.scene.record.series_ticks == ticks
    sine = {"preset": "real_time", speed_law: {"kind": "sine", "amplitude": 0.1, "frequency_hz": 1.0}}
    assert load_scene("field_tine", sine).timing.communication_step_ns == 1_250_000


def test_keys_of_the_wedge_model_can_be_set():
    """Beside the preset `soil` is the wedge model; those of the particles are unknown to it."""
    found = load_scene("field_tine", {"preset": "real_time", "soil.seed": 3})
    assert found.scene.wedge_soil.seed == 3
    with pytest.raises(SceneError, match=r"soil\.bed"):
        load_scene("field_tine", {"preset": "real_time", "soil.bed.seed": 3})


def test_a_written_scene_is_the_same_scene(tmp_path):
    """A run records its scene with the preset applied: it loads to the same hash, name and errors."""
    found = load_scene("field_tine", {"preset": "standard"})
    found.write(tmp_path / "scene.yaml")
    again = load_scene(tmp_path / "scene.yaml")
    assert again.scene_hash == found.scene_hash
    assert again.preset == "standard"
    assert again.presets["standard"] == found.presets["standard"]


def test_presets_are_listed_without_a_choice():
    """The scene as written has them all to choose from; a soil that is no material has none."""
    assert tuple(load_scene("field_tine").presets) == OF_MATERIALS
    assert load_scene("tine").presets == {}
    with pytest.raises(SceneError, match=r"'standard' is for a soil\.material .*, and this scene has none"):
        load_scene("tine", {"preset": "standard"})


def test_no_tool_in_the_soil():
    """Without a depth there is no size to choose."""
    with pytest.raises(SceneError, match=r"preset coarse: .*set soil.particles.radius_m instead"):
        load_scene("field_tine", {"preset": "coarse", "tools.tine.path.start_z_m": 0.35})


def test_a_preset_of_the_scene_itself_comes_first(tmp_path: Path):
    """A scene may call its own preset `coarse`."""
    path = tmp_path / "scene.yaml"
    base = Path(load_scene("field_tine").path)
    changes = "{soil: {particles: {radius_m: 0.018}}}"
    path.write_text(f"base: {base}\nname: own\npresets: {{coarse: {{changes: {changes}}}}}\n")
    assert radius_mm(load_scene(path, {"preset": "coarse"})) == pytest.approx(18.0)


@pytest.mark.parametrize(
    ("preset", "row"),
    [("fine", "reference"), ("standard", "standard"), ("coarse", "coarse"), ("real_time", "real_time")],
)
def test_quoted_errors_are_those_of_the_study(preset, row):
    """config/presets/loam.yaml against the shipped table; of `fine` the interval of its own means."""
    root = Path(__file__).parents[3]
    table = pd.read_csv(root / "validation/studies/field_tine.csv").set_index("preset").loc[row]
    expected = load_scene("field_tine").presets[preset].expected
    assert expected is not None
    assert expected.errors
    for name, error in expected.errors.items():
        unit = table["draft_mean_newton" if name.startswith("vertical") else name]
        half = (table[f"{name}_high"] - table[name]) / abs(unit)
        ends = [table[f"{name}_error{end}"] for end in ("", "_low", "_high")]
        found = [0.0, -half, half] if preset == "fine" else ends
        assert [error.mean, error.low, error.high] == pytest.approx(found, abs=6e-5), name


def test_a_wedge_model_is_offered_where_one_comes_with_the_material() -> None:
    """In dry sand only presets of particles, with their errors beside the limit of small ones."""
    assert tuple(load_scene("field_tine").presets) == OF_MATERIALS
    sand = load_scene("field_tine", ["soil.material=dry_sand"]).presets
    assert tuple(sand) == OF_MATERIALS[:-1]
    assert all(preset.expected is not None for preset in sand.values())
