"""Accuracy presets of a scene: laid over it, carried along, quoted by check with what a study measured."""

import textwrap
from pathlib import Path

import pytest

from subsoil_ros.cli.main import main
from subsoil_ros.errors import SceneError
from subsoil_ros.loading.loader import load_scene

Captured = pytest.CaptureFixture[str]
SCENE = """
name: pendulum
duration_s: 0.1
mechanism:
  bodies:
    bob: {mass_kg: 2, inertia_kg_m2: 0.5, position_m: [0.0, -1.0]}
  joints:
    pivot: {kind: revolute, body_a: ground, body_b: bob, point_m: [0.0, 0.0]}
presets:
  fine: {changes: {coupling: {mechanism_steps: 8}}}
  coarse:
    changes: {coupling: {communication_step_ns: 2000000}}
    expected:
      against: reference, 3 bed seeds
      errors: {draft_mean_newton: {mean: -0.03, low: -0.05, high: -0.01}}
      errors_against: {r = 7 mm: {draft_mean_newton: {mean: 0.02, low: -0.04, high: 0.08}}}
      confidence: 0.95
      notes: [swings where the reference does not]
      wall_s_per_simulated_s: 12.0
      machine: two cores
      source: docs/results/study.csv
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.yaml"
    path.write_text(SCENE)
    return path


def test_a_preset_is_laid_over_the_scene(scene_file: Path) -> None:
    """Chosen by --set or in the file; a single value still wins over it; without a choice the scene stays."""
    plain = load_scene(scene_file)
    assert (plain.preset, plain.timing.communication_step_ns, plain.timing.mechanism_steps) == (
        None,
        500_000,
        1,
    )
    assert list(plain.presets) == ["fine", "coarse"]
    assert load_scene(scene_file, ["preset=fine"]).timing.mechanism_steps == 8
    assert load_scene(scene_file, ["preset=fine", "coupling.mechanism_steps=3"]).timing.mechanism_steps == 3
    scene_file.write_text(SCENE + "preset: coarse\n")
    chosen = load_scene(scene_file)
    assert (chosen.preset, chosen.timing.communication_step_ns) == ("coarse", 2_000_000)
    assert load_scene(scene_file, ["preset=fine"]).timing.communication_step_ns == 500_000


@pytest.mark.parametrize("name", ["coarse", "fine"])
def test_written_scene_keeps_its_preset(scene_file: Path, tmp_path: Path, name: str) -> None:
    """What a run writes down loads to the same scene, knows the preset and what was measured of it."""
    first = load_scene(scene_file, [f"preset={name}"])
    first.write(tmp_path / "copy.yaml")
    second = load_scene(tmp_path / "copy.yaml")
    assert (second.scene_hash, second.document) == (first.scene_hash, first.document)
    assert second.preset == name
    assert second.presets[name].expected == first.presets[name].expected


def test_presets_of_the_base(scene_file: Path) -> None:
    """Changes are inherited, what was measured of another scene is not; null drops them all."""
    child = scene_file.with_name("child.yaml")
    child.write_text("base: pendulum.yaml\nname: child\npreset: coarse\n")
    found = load_scene(child)
    assert found.timing.communication_step_ns == 2_000_000
    assert found.presets["coarse"].expected is None
    child.write_text("base: pendulum.yaml\nname: child\npresets: null\n")
    assert load_scene(child).presets == {}


@pytest.mark.parametrize(
    ("override", "old", "new", "words"),
    [
        ("preset=coarser", "", "", ["--preset: no preset 'coarser'", "did you mean 'coarse'"]),
        ("presets.fine=1", "", "", ["'presets' cannot be set", "preset=NAME"]),
        ("name=x", "presets:", "initial_conditions:", ["initial_condition: is missing"]),
        ("name=x", "fine: {changes", "fine: {changed", ["presets.fine: changed: unknown key", "'changes'"]),
        ("name=x", "confidence: 0.95", "confidence: 95", ["presets.coarse: expected.confidence: given 95"]),
        (
            "preset=fine",
            "mechanism_steps: 8",
            "mechanism_step: 8",
            ["coupling.mechanism_step: unknown key"],
        ),
        ("name=x", "duration_s", "prese: fine\nduration_s", ["did you mean 'preset'"]),
    ],
)
def test_bad_presets(scene_file: Path, override: str, old: str, new: str, words: list[str]) -> None:
    """Refused with the place and what is allowed."""
    scene_file.write_text(SCENE.replace(old, new, 1) if old else SCENE)
    with pytest.raises(SceneError) as caught:
        load_scene(scene_file, [override])
    for word in words:
        assert word in str(caught.value)


def test_check_quotes_what_was_measured(scene_file: Path, capsys: Captured) -> None:
    """With source and interval where a study was made; where not, it says so and invents nothing."""
    assert main(["check", str(scene_file), "--preset", "coarse", "--set", "duration_s=0.5"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in ("reference, 3 bed seeds", "-3 %", "-5 to -1 %", "against r = 7 mm", "-4 to +8 %",
                  "study.csv",
                  "swings where the reference does not",
                  "expected wall time: 6 s", "measured without --set duration_s=0.5"):  # fmt: skip
        assert words in text
    assert main(["check", str(scene_file), "--preset", "fine"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "fine: no study has measured its error and its time in this scene and soil" in text
    assert main(["check", str(scene_file)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "presets of this scene: fine, coarse" in text
    assert "measured without" not in text
    assert "against r = 7 mm, in % preset draft_mean_newton coarse +2.0 (-4.0 to +8.0)" in text
    assert "coarse: swings where the reference does not" in text
    assert "coarse -3.0 (-5.0 to -1.0) 1.2 s" in text  # of 0.1 s; nothing is said of what was not measured
    assert main(["check", str(scene_file), "--set", "gravity_m_per_s2=5.0"]) == 0
    assert "measured without --set gravity_m_per_s2=5.0" in " ".join(capsys.readouterr().out.split())


def test_files_of_a_preset_are_seen_from_its_scene(tmp_path: Path) -> None:
    """A preset may bring a soil file or a mesh, by a name relative to the file it stands in."""
    (tmp_path / "below").mkdir()
    scenes = Path(__file__).parents[3] / "config" / "scenes"
    soil = scenes.parent / "soils" / "paper_grid.yaml"
    (tmp_path / "below" / "soil.yaml").write_text(soil.read_text())
    (tmp_path / "below" / "scene.yaml").write_text(
        textwrap.dedent(f"""
        base: {scenes / "tine.yaml"}
        name: with_preset
        presets:
          wedge: {{changes: {{soil: {{model: wedge, file: soil.yaml}}}}}}
        """)
    )
    (tmp_path / "top.yaml").write_text("base: below/scene.yaml\nname: top\n")
    assert load_scene(tmp_path / "top.yaml", ["preset=wedge"]).scene.wedge_soil is not None
