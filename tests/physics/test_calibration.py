"""Values of a wedge model that are known are found again from its own pulls."""

import json
import math
from pathlib import Path

import pytest
import yaml
from numpy.testing import assert_allclose

from subsoil_ros.api.execution import execute
from subsoil_ros.cli.main import main
from subsoil_ros.experiments.pulls import Measured, numbers, pull
from subsoil_ros.experiments.run_cache import keep_run
from subsoil_ros.experiments.wedge_design import base_scene, point_overrides, read_design, tip_of
from subsoil_ros.experiments.wedge_fit import steady
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.soil_file import read_soil_file
from subsoil_ros.wedge.wedge_engine import WedgeEngine
from tests.unit.experiments.designs import SCENES, small_design

Captured = pytest.CaptureFixture[str]

KNOWN = {
    "density_kg_per_m3": 1333.0,
    "cohesion_pa": 6e3,
    "friction_angle_rad": 0.45,
    "adhesion_pa": 1.5e3,
    "tool_friction_angle_rad": 0.25,
    "shank_fraction": 0.4,
    "speed_factor": 1.2,
    "failure": "gradual",
    "drop": 0.6,
    "block_depth_m": 0.15,
    "variation": 0.0,
    "length_variation": 0.5,
    "period_m": 0.06,
}
FAST = {"tine": {"path": {"speed_x_m_per_s": {"kind": "constant", "value": 1.0}}}}


@pytest.fixture
def design(tmp_path: Path) -> Path:
    """A small design on tine.yaml."""
    return small_design(tmp_path)


def test_values_that_are_known_are_found(design: Path, tmp_path: Path, capsys: Captured) -> None:
    """Pulls of a wedge model, kept as if they were runs, give back its values; no run is made anew. Particles
    may reach into the tool; the wedge model's may not."""
    document = yaml.safe_load(design.read_text())
    document["overrides"].append("tools.tine.setback_m=0.002")
    design.write_text(yaml.safe_dump(document))
    found = read_design(design)
    scene = base_scene(design, found)
    wedge = "soil={model: wedge, values: " + json.dumps(KNOWN) + "}"
    for point in (*found.fit, *found.check):
        changes = point_overrides(scene, found, point, 0)
        soil = load_scene(scene.path, (*changes, wedge, "tools.tine.setback_m=0.0"))
        keep_run(tmp_path / "runs", load_scene(scene.path, changes), execute(soil))
    out = tmp_path / "soil.yaml"
    assert main(["calibrate", str(design), "--out", str(out), "--runs", str(tmp_path / "runs")]) == 0
    assert "running" not in capsys.readouterr().err
    soil_file = read_soil_file(out)
    # bed and soil differ in density by 3 %, and the springs' lag and drop shift the means by about 2 %
    for name in ("cohesion_pa", "friction_angle_rad", "tool_friction_angle_rad", "shank_fraction"):
        assert getattr(soil_file.values, name) == pytest.approx(KNOWN[name], rel=0.1)
    assert soil_file.values.failure == "gradual"
    for name in ("drop", "block_depth_m", "length_variation", "period_m"):
        assert getattr(soil_file.values, name) == pytest.approx(KNOWN[name], rel=0.2)
    assert soil_file.fitted_range.depth_m == (0.10, 0.20)
    assert soil_file.fitted_range.rake_rad == pytest.approx((math.radians(25.0), math.radians(25.0) + 0.2))
    for row in soil_file.report["points"]:
        draft, model = row["draft_newton"]
        assert model == pytest.approx(draft, rel=0.05)
        deviation, model = row["deviation_newton"]
        assert model == pytest.approx(deviation, rel=0.25)
        assert row["power_ratio"][2] == pytest.approx(
            1.0, rel=0.5
        )  # of the waves of 40 to 80 mm, the cycle's
    # the file runs in a scene whose particles it was fitted to
    use = {"model": "wedge", "file": str(out), "fitted_to": str(SCENES / "tine.yaml")}
    scene = {"base": str(SCENES / "tine.yaml"), "soil": use, "tools": FAST}
    (tmp_path / "use.yaml").write_text(yaml.safe_dump(scene))
    load_scene(tmp_path / "use.yaml")


def test_steady_forces_are_those_of_a_long_pull(design: Path) -> None:
    """Share and shank, x and z, over a pull of 3 m whose blocks fail gradually and evenly."""
    found = read_design(design)
    point = found.fit[1]
    soil = KNOWN | {"drop": 0.9, "length_variation": 0.0, "block_depth_m": 0.5}
    scene = base_scene(design, found)
    wedge = "soil={model: wedge, values: " + json.dumps(soil) + "}"
    resolved = load_scene(scene.path, (*point_overrides(scene, found, point, 0), wedge))
    tip_x = tip_of(scene)[1][0]
    item = numbers(pull(resolved), tip_x, (0.2, 3.2), 0.01)
    x, z = steady(WedgeEngine(resolved), Measured(point, resolved, tip_x, [item], True))
    assert_allclose(x, item.mean_x_newton, rtol=0.03)  # a tick is a sixtieth of the cycle
    assert_allclose(z, item.mean_z_newton, rtol=0.03)  # a tick is a sixtieth of the cycle
