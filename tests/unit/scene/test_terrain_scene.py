"""A terrain in scenes: values from a material, what is refused, and what `check` says."""

import math
from pathlib import Path
from typing import Any

import pytest

from subsoil_ros.cli.main import main
from subsoil_ros.errors import SceneError
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.yaml_document import dump_yaml

BUCKET = Path(__file__).parents[3] / "examples" / "bucket_arm" / "bucket.stl"
BIN = {"length_m": 1.0, "width_m": 0.8, "depth_m": 0.3}
VALUES = {
    "density_kg_per_m3": 1500.0, "cohesion_pa": 5e3, "friction_angle_rad": 0.5, "adhesion_pa": 1e3,
    "loose_friction_angle_rad": 0.4, "tool_friction_angle_rad": 0.3,
}  # fmt: skip


def document(**soil: Any) -> dict[str, Any]:
    """A bucket over a terrain."""
    path = {"start_x_m": 0.5, "start_z_m": 0.1, "speed_x_m_per_s": 0.1}
    tool = {"path": path, "groups": {"bucket": {"mesh": str(BUCKET)}}}
    return {
        "name": "dig",
        "duration_s": 0.1,
        "soil": {"model": "terrain", "bin": BIN, **soil},
        "tools": {"bucket": tool},
    }


def load(*overrides: str, **soil: Any) -> ResolvedScene:
    """The scene of `document`."""
    return load_scene(document(**soil), overrides)


def test_a_material_gives_the_values_that_the_scene_leaves_out() -> None:
    """Peak values by the laboratory, loose ones as measured; values of the scene and overrides win."""
    found = load("soil.values.adhesion_pa=100", material="sandy_loam", values={"cohesion_pa": 4e3})
    soil = found.scene.terrain_soil
    assert soil is not None
    assert found.material is None
    assert not found.presets
    values = soil.values
    assert (values.cohesion_pa, values.adhesion_pa, values.density_kg_per_m3) == (4e3, 100.0, 1500.0)
    assert values.friction_angle_rad == pytest.approx(math.radians(30.0))
    assert values.loose_cohesion_pa == pytest.approx(2069.7, rel=1e-4)
    assert values.loose_friction_angle_rad == pytest.approx(math.radians(27.067), rel=1e-4)


@pytest.mark.parametrize(
    ("soil", "message"),
    [
        ({"values": VALUES | {"loose_friction_angle_rad": 0.6}}, "loose_friction_angle_rad: 0.6 is above"),
        (
            {"values": VALUES | {"loose_cohesion_pa": 6e3}},
            "loose_cohesion_pa: 6000 is above cohesion_pa 5000",
        ),
        ({"values": VALUES, "bin": BIN | {"sides": "periodic"}}, "bin.sides: given 'periodic'"),
        ({"values": VALUES, "cell_m": 0.3}, "cell_m: given 0.3"),
        ({"values": VALUES, "cell_m": 1e-4}, "80,000,000 cells"),
        ({"values": VALUES, "window": {}}, "soil.terrain.window|window"),
        ({}, "values"),
    ],
)
def test_what_a_terrain_cannot_be_is_refused(soil: dict[str, Any], message: str) -> None:
    """One message, which says what is allowed."""
    with pytest.raises(SceneError, match=message):
        load(**soil)


def test_check_and_a_run_say_what_the_bucket_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The soil's rows of `check`, and a run with its map of heights in the bag."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(dump_yaml(document(material="dry_sand") | {"record": {"cloud_hz": 20.0}}))
    assert main(["check", str(scene)]) == 0
    shown = capsys.readouterr().out
    assert "holds 1.5" in shown
    assert "50 x 40 of 20 mm" in shown
    assert main(["run", str(scene), "--mode", "direct", "--out", str(tmp_path / "out")]) == 0
    assert main(["bag", "info", str(tmp_path / "out" / "bag")]) == 0
    assert "/soil/height_map" in capsys.readouterr().out
