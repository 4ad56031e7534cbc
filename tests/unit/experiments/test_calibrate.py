"""subsoil calibrate: finds values that are known, keeps runs, and says what is wrong with a design."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from subsoil_ros.api.execution import execute
from subsoil_ros.cli.main import main
from subsoil_ros.experiments.calibration.design import base_scene, point_overrides, read_design, tip_of
from subsoil_ros.experiments.calibration.fluctuation import octave_edges_m
from subsoil_ros.experiments.calibration.measured import Measured
from subsoil_ros.experiments.calibration.runs import Pull, numbers, pull
from subsoil_ros.experiments.calibration.wedge import steady
from subsoil_ros.experiments.run_cache import keep_run
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.loading.soil_file import read_soil_file
from subsoil_ros.wedge.wedge_engine import WedgeEngine

Captured = pytest.CaptureFixture[str]
SCENES = Path(__file__).parents[3] / "config" / "scenes"
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
POINTS = [(0.10, 1.0, 0.0), (0.20, 1.0, 0.0), (0.20, 3.0, 0.0), (0.15, 2.0, -0.2)]


FAST = {"tine": {"path": {"speed_x_m_per_s": {"kind": "constant", "value": 1.0}}}}


def write(path: Path, document: dict) -> Path:
    """A YAML file."""
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


@pytest.fixture
def design(tmp_path: Path) -> Path:
    """A small design on tine.yaml."""
    points = [{"depth_m": d, "speed_m_per_s": v, "tilt_rad": t} for d, v, t in POINTS]
    return write(
        tmp_path / "design.yaml",
        {
            "model": "wedge",
            "scene": str(SCENES / "tine.yaml"),
            "overrides": [
                "coupling.communication_step_ns=1000000",
                "soil.bin={length_m: 3.4, width_m: 0.25, depth_m: 0.27}",
            ],
            "window_m": [0.2, 3.2],
            "fit": points,
            "check": [{"depth_m": 0.18, "speed_m_per_s": 2.0}],
        },
    )


def test_values_that_are_known_are_found(design: Path, tmp_path: Path, capsys: Captured) -> None:
    """Pulls of a wedge model, kept as if they were runs, give back its values; no run is made anew."""
    found = read_design(design)
    scene = base_scene(design, found)
    wedge = "soil={model: wedge, values: " + json.dumps(KNOWN) + "}"
    for point in (*found.fit, *found.check):
        changes = point_overrides(scene, found, point, 0)
        soil = load_scene(scene.path, (*changes, wedge))
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
    load_scene(write(tmp_path / "use.yaml", {"base": str(SCENES / "tine.yaml"), "soil": use, "tools": FAST}))


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


def test_numbers_of_a_known_wave() -> None:
    """A sine on a trend: deviation, power in its own octave, variance of its means in closed form."""
    x = np.arange(0.0, 1.0, 5e-4)
    draft = 1000.0 + 300.0 * x + 50.0 * np.sin(2.0 * np.pi * x / 0.06)
    read = numbers(Pull(x, -draft[:, None], 0.0 * draft[:, None], ("share",)), 0.1, (0.3, 0.9), 0.01)
    variance = 0.5 * 50.0**2
    assert read.deviation_newton == pytest.approx(math.sqrt(variance), rel=0.01)
    assert_allclose(octave_edges_m(0.01, 0.6), [0.01, 0.02, 0.04, 0.08])
    assert_allclose(read.octave_power, [0.0, 0.0, variance], atol=0.01 * variance)
    smoothed = np.sinc(0.1 / 0.06) ** 2  # a mean over 0.1 m of a wave of 0.06 m
    assert read.variance_of_means[0] == pytest.approx(variance * smoothed, rel=0.1)
    assert read.draft_newton == pytest.approx(1000.0 + 300.0 * 0.5, rel=0.01)


def test_tip_stands_where_the_point_says(design: Path) -> None:
    """However the tool is turned, its tip starts at start_tip_x_m and depth_m; replicates stand elsewhere."""
    found = read_design(design)
    scene = base_scene(design, found)
    name, (x, z) = tip_of(scene)
    for point in found.fit:
        path = load_scene(scene.path, point_overrides(scene, found, point, 0)).scene.tools[name].path
        assert path is not None
        c, s = math.cos(point.tilt_rad), math.sin(point.tilt_rad)
        assert path.start_x_m + c * x - s * z == pytest.approx(-0.05)
        assert path.start_z_m + s * x + c * z == pytest.approx(-point.depth_m)
    one, two = (load_scene(scene.path, point_overrides(scene, found, found.fit[0], k)) for k in (0, 1))
    assert one.scene_hash != two.scene_hash


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scene": "none.yaml"}, "none.yaml: no such file"),
        ({"scene": str(SCENES / "mechanism_only.yaml"), "overrides": []}, "has no soil of particles"),
        ({"fit": []}, "fit: given a list of 0; it must be a list of at least 3 entries"),
        ({"model": "cam_clay"}, "model: given the text 'cam_clay'; it must be 'wedge'"),
        ({"fitt": 1}, "fitt: unknown key 'fitt'; did you mean 'fit'?"),
    ],
)
def test_bad_design(design: Path, tmp_path: Path, capsys: Captured, change: dict, words: str) -> None:
    """One message with the place; exit status 2; nothing written."""
    write(design, yaml.safe_load(design.read_text()) | change)
    out = tmp_path / "out.yaml"
    assert main(["calibrate", str(design), "--out", str(out), "--runs", str(tmp_path / "runs")]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_results_are_never_written_over(design: Path, capsys: Captured) -> None:
    """--out names a new file."""
    assert main(["calibrate", str(design), "--out", str(design)]) == 2
    assert "exists already" in capsys.readouterr().err
