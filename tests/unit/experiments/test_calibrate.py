"""subsoil calibrate: finds values that are known, keeps runs, and says what is wrong with a design."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from subsoil_ros.cli.main import main
from subsoil_ros.experiments.fluctuation import octave_edges_m
from subsoil_ros.experiments.pulls import Pull, numbers
from subsoil_ros.experiments.wedge_design import base_scene, point_overrides, read_design, tip_of
from subsoil_ros.loading.loader import load_scene

from .designs import SCENES, small_design

Captured = pytest.CaptureFixture[str]


@pytest.fixture
def design(tmp_path: Path) -> Path:
    """A small design on tine.yaml."""
    return small_design(tmp_path)


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
    design.write_text(yaml.safe_dump(yaml.safe_load(design.read_text()) | change, sort_keys=False))
    out = tmp_path / "out.yaml"
    assert main(["calibrate", str(design), "--out", str(out), "--runs", str(tmp_path / "runs")]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_results_are_never_written_over(design: Path, capsys: Captured) -> None:
    """--out names a new file."""
    assert main(["calibrate", str(design), "--out", str(design)]) == 2
    assert "exists already" in capsys.readouterr().err
