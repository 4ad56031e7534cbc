"""subsoil calibrate: finds values that are known, keeps runs, and says what is wrong with a design."""

import json
import math
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from subsoil_ros.api.execution import execute
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError
from subsoil_ros.experiments.calibration import law, soil_results
from subsoil_ros.experiments.calibration.design import (
    DraftTarget,
    WedgeDesign,
    base_scene,
    point_overrides,
    read_design,
    tip_of,
)
from subsoil_ros.experiments.calibration.fluctuation import octave_edges_m
from subsoil_ros.experiments.calibration.measured import Measured
from subsoil_ros.experiments.calibration.runs import Pull, numbers, pull
from subsoil_ros.experiments.calibration.soil_results import slope_rad
from subsoil_ros.experiments.calibration.wedge import steady
from subsoil_ros.experiments.run_cache import keep_run
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.loading.soil_file import read_soil_file
from subsoil_ros.wedge.engine import WedgeEngine

Captured = pytest.CaptureFixture[str]
SCENES = Path(__file__).parents[2] / "config" / "scenes"
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
    assert isinstance(found, WedgeDesign)
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
    assert isinstance(found, WedgeDesign)
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
    assert isinstance(found, WedgeDesign)
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
        ({"model": "cam_clay"}, ": model: given the text 'cam_clay', allowed are wedge, dem"),
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


ADHESION = "soil.law.particle.cohesive_stiffness_newton_per_m"
FRICTION = "soil.law.particle.sliding_friction"


@pytest.fixture
def law_design(tmp_path: Path) -> Callable[..., Path]:
    """A design that looks for adhesion and friction of tine.yaml by its draft and a heap."""

    def make(**changes: object) -> Path:
        document = {
            "model": "dem",
            "scene": str(SCENES / "tine.yaml"),
            "parameters": [
                {"key": ADHESION, "lowest": 1000.0, "largest": 9000.0},
                {"key": FRICTION, "lowest": 0.1, "largest": 0.9},
            ],
            "targets": [
                {"kind": "draft", "draft_newton": 900.0},
                {"kind": "angle_of_repose", "angle_rad": 0.5, "column_m": [0.1, 0.1, 0.2]},
            ],
            **changes,
        }
        return write(tmp_path / "law.yaml", document)

    return make


@pytest.fixture
def known_tests(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Soil tests with a known answer (3000 N/m, 0.4) instead of runs; lists what was tested."""
    tested: list[str] = []

    def values(scene: ResolvedScene) -> tuple[float, float]:
        soil = scene.scene.particle_soil
        assert soil is not None
        tested.append(scene.scene_hash)
        return soil.law.particle.cohesive_stiffness_newton_per_m, soil.law.particle.sliding_friction  # type: ignore[union-attr]

    def draft(scene: ResolvedScene, *_: object) -> dict[str, float]:
        adhesion, friction = values(scene)
        return {"draft_newton": 900.0 * (adhesion / 3000.0) ** 0.5 * (0.6 + friction)}

    def heap(scene: ResolvedScene, *_: object) -> dict[str, float]:
        adhesion, friction = values(scene)
        return {"angle_rad": 0.5 * (friction / 0.4) * (0.9 + 0.1 * adhesion / 3000.0)}

    monkeypatch.setattr(law, "draft_results", draft)
    monkeypatch.setattr(law, "repose_results", heap)
    return tested


def test_a_law_is_fitted_and_the_fit_resumes(
    law_design: Callable[..., Path], known_tests: list[str], tmp_path: Path
) -> None:
    """Two parameters from two tests; a second fit finds every test kept; the result loads as a scene."""
    arguments = ["calibrate", str(law_design()), "--runs", str(tmp_path / "runs"), "--out"]
    assert main([*arguments, str(tmp_path / "one.yaml")]) == 0
    count = len(known_tests)
    report = json.loads((tmp_path / "one.json").read_text())
    assert report["parameters"][ADHESION]["value"] == pytest.approx(3000.0, rel=0.03)
    assert report["parameters"][FRICTION]["value"] == pytest.approx(0.4, rel=0.03)
    assert 0.0 < report["parameters"][FRICTION]["standard_error"] < 0.1
    assert report["finished"]
    assert main([*arguments, str(tmp_path / "two.yaml")]) == 0
    assert len(known_tests) == count
    soil = load_scene(tmp_path / "two.yaml").scene.particle_soil
    assert soil is not None
    assert soil.law.particle.cohesive_stiffness_newton_per_m == report["parameters"][ADHESION]["value"]  # type: ignore[union-attr]
    assert soil.law.boundary.cohesive_stiffness_newton_per_m == 3000.0  # type: ignore[union-attr]


def test_largest_runs_ends_a_fit_with_the_best_so_far(
    law_design: Callable[..., Path], known_tests: list[str], tmp_path: Path
) -> None:
    """And says that it is not finished."""
    design = law_design(max_runs=4)
    out = tmp_path / "law_fit.yaml"
    assert main(["calibrate", str(design), "--runs", str(tmp_path / "runs"), "--out", str(out)]) == 0
    report = json.loads(out.with_suffix(".json").read_text())
    assert not report["finished"]
    assert report["sets_tested"] == 4
    assert len(known_tests) == 8


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"parameters": [{"key": "soil.law.kind", "lowest": 0.0, "largest": 1.0}]},
            "soil.law.kind is no number",
        ),
        ({"parameters": [{"key": ADHESION, "lowest": 0.0, "largest": 1.0}]}, "starts at 7000 in"),
        ({"targets": [{"kind": "penetration"}]}, "penetration"),
    ],
)
def test_bad_law_design(
    law_design: Callable[..., Path],
    tmp_path: Path,
    capsys: Captured,
    change: dict,
    words: str,
) -> None:
    """Refused before anything runs."""
    out = tmp_path / "fit.yaml"
    assert main(["calibrate", str(law_design(**change)), "--out", str(out)]) == 2
    assert words in capsys.readouterr().err


def test_a_draft_is_the_mean_over_the_beds_of_its_target(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each seed lays another bed; on a bed without anything random it is refused."""

    def no_progress(*_: object) -> nullcontext[Callable[[int], None]]:
        return nullcontext(lambda tick: None)

    def known(scene: ResolvedScene, *_: object) -> float:
        soil = scene.scene.particle_soil
        assert soil is not None
        return 100.0 * soil.bed.seed  # type: ignore[union-attr]

    monkeypatch.setattr(soil_results, "_draft_newton", known)
    target = DraftTarget(kind="draft", draft_newton=900.0, seeds=(3, 5))
    jittered = load_scene(SCENES / "tine.yaml", ["soil.bed.jitter_m=1.0e-4"])
    assert soil_results.draft_results(jittered, target, tmp_path, 1, no_progress) == {"draft_newton": 400.0}
    with pytest.raises(InputError, match="seeds would change nothing"):
        soil_results.draft_results(load_scene(SCENES / "tine.yaml"), target, tmp_path, 1, no_progress)


def test_the_run_of_a_draft_is_a_kept_run(tmp_path: Path) -> None:
    """One that a sweep has made is not run again; the force of every tick is in it."""
    every_tick = ["record.series_ticks=1", "record.cloud_hz=0.0"]
    wedge = f"soil={{model: wedge, file: {SCENES.parent / 'soils' / 'paper_grid.yaml'}}}"
    run = execute(load_scene(SCENES / "tine.yaml", [*every_tick, wedge]))
    kept = keep_run(tmp_path, load_scene(SCENES / "tine.yaml", every_tick), run)

    def never(name: str, timing: object) -> nullcontext[Callable[[int], None]]:
        raise AssertionError(f"{name} was run")

    target = DraftTarget(kind="draft", draft_newton=900.0)
    found = soil_results.draft_results(load_scene(SCENES / "tine.yaml"), target, tmp_path, 1, never)
    assert found["draft_newton"] == pytest.approx(kept.summary["series"]["draft_newton"]["mean"], rel=0.01)


def test_slope_of_a_heap() -> None:
    """Spheres under a line of 30 degrees against a wall."""
    radius = 0.01
    x, z = np.meshgrid(np.arange(radius, 0.6, radius / 2.0), np.arange(0.0, 0.3, radius / 4.0))
    under = z < 0.3 - math.tan(math.radians(30.0)) * x
    heap = np.column_stack([x[under], 0.0 * x[under], z[under]])
    assert slope_rad(heap, radius) == pytest.approx(math.radians(30.0), abs=math.radians(1.5))
    assert slope_rad(np.column_stack([x[0], x[0], 0.0 * x[0]]), radius) == 0.0
