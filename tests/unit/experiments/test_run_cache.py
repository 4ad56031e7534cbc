"""Runs kept by the hash of their scene: the numbers of `subsoil run`, found again, replaced."""

import json
from pathlib import Path

import numpy as np
import pytest

from subsoil_ros.analysis.series import read_series, read_series_csv, read_table_csv
from subsoil_ros.analysis.summary import SCHEMA_VERSION
from subsoil_ros.api.execution import execute
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError, RunError
from subsoil_ros.experiments.run_cache import CachedRun, find_run, keep_run, warn_of_other_code
from subsoil_ros.experiments.run_metrics import dominant_frequency_hz, half_widths_of, metrics_of, swing
from subsoil_ros.loading.loader import ResolvedScene, load_scene

SCENES = Path(__file__).parents[3] / "config" / "scenes"
FAST_PULL = (
    f"soil={{model: wedge, file: {SCENES.parent / 'soils' / 'paper_grid.yaml'}}}",
    "duration_s=0.3",
    "record.series_ticks=3",
    "report.window_inside_m=0.0",
)
TOO_FAST = "tools.tine.path.speed_x_m_per_s={kind: ramp, start_value: 0.5, end_value: 4.0, end_s: 0.3}"


def scene(*overrides: str) -> ResolvedScene:
    """The tine on a wedge model: 300 ticks in a fraction of a second."""
    return load_scene(SCENES / "tine.yaml", (*FAST_PULL, *overrides))


def test_kept_series_are_those_of_a_run(tmp_path: Path) -> None:
    """The same bits as `subsoil run --mode direct` of the kept scene.yaml, whose bag is not kept."""
    found = scene()
    kept = keep_run(tmp_path / "cache", found, execute(found))
    assert kept.failure is None
    assert (
        main(["run", str(kept.folder / "scene.yaml"), "--mode", "direct", "--out", str(tmp_path / "run")])
        == 0
    )
    ours, theirs = kept.series(), read_series(tmp_path / "run" / "bag", found.scene)
    assert list(ours.columns) == list(theirs.columns)
    for name, values in theirs.columns.items():
        np.testing.assert_array_equal(ours[name], values)
        assert ours[name].dtype == values.dtype
    assert kept.summary["scene"]["hash"] == found.scene_hash


def test_a_run_of_other_engines_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It is kept, and may have other numbers."""
    found = scene()
    kept = keep_run(tmp_path, found, execute(found))
    warn_of_other_code([kept])
    assert not caplog.messages
    facts = json.loads((kept.folder / "run.json").read_text())
    (kept.folder / "run.json").write_text(json.dumps(facts | {"code": "0123456789abcdef"}))
    warn_of_other_code([CachedRun(kept.folder)])
    (message,) = caplog.messages
    assert f"another version of the engines, whose numbers may differ: 1; remove {tmp_path}" in message


def test_time_is_that_of_the_ticks(tmp_path: Path) -> None:
    """Wall and CPU time are there, CPU time of one thread is at most a little more than wall time."""
    facts = execute(scene(), warm_up=True).facts
    assert 0.0 < facts["wall_s"] < facts["whole_wall_s"]
    assert facts["cpu_s"] > 0.0
    assert (facts["threads"], facts["at_once"]) == (1, 1)


def test_a_run_that_fails_is_kept_with_its_message(tmp_path: Path) -> None:
    """And with the series up to there; a good one takes its place."""
    found = scene(TOO_FAST)
    kept = keep_run(tmp_path, found, execute(found))
    assert "m/s fast, the soil file was fitted up to" in str(kept.failure)
    assert 0 < len(kept.series()) < 100
    assert not kept.summary["run"]["complete"]
    assert isinstance(kept.error("here"), RunError)
    again = keep_run(tmp_path, found, execute(scene()))
    assert again.folder == kept.folder
    assert again.failure is None
    assert [path.name for path in tmp_path.iterdir()] == [kept.folder.name]


def test_bad_input_is_a_failure_with_its_own_status() -> None:
    """A scene that cannot be run at all is told apart from a run that failed."""
    found = scene("soil.bin.length_m=0.6")
    external = load_scene(
        SCENES / "subsoiler_1s300_draft_limit.yaml", ["controller.law={kind: external}", "duration_s=0.001"]
    )
    assert execute(external).facts["exit_status"] == 2
    assert execute(found).facts["exit_status"] == 0


def test_what_is_not_whole_is_not_found(tmp_path: Path) -> None:
    """A folder without run.json is no cached run."""
    found = scene()
    assert find_run(tmp_path, found.scene_hash) is None
    (tmp_path / found.scene_hash[:32]).mkdir()
    assert find_run(tmp_path, found.scene_hash) is None
    kept = keep_run(tmp_path, found, execute(found))
    assert find_run(tmp_path, found.scene_hash) == kept


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds 0 lines"),
        ("time_s\n", "holds 1 lines"),
        ("time_s,\n1,2\n", "a column has no name"),
        ("time_s,a\n1,2,3\n", "row 2 has 3 cells"),
        ("time_s,a\n1,2\n2,x\n", "row 3, column 'a': 'x' is no number"),
        ("time,a\n1,2\n", "has no column 'time_s'"),
    ],
)
def test_bad_csv(tmp_path: Path, text: str, words: str) -> None:
    """One message with file and place."""
    path = tmp_path / "series.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_series_csv(path)
    assert str(path) in str(caught.value)
    assert words in str(caught.value)


def test_csv_of_a_spreadsheet(tmp_path: Path) -> None:
    """A byte order mark, comments, blanks around names and missing values are taken."""
    path = tmp_path / "field.csv"
    path.write_text("# field 7\n time_s , draft_newton\n0.0,nan\n0.5,900\n", encoding="utf-8-sig")
    found = read_table_csv(path)
    assert list(found) == ["time_s", "draft_newton"]
    assert found["draft_newton"][1] == 900.0


def test_frequency_of_a_known_wave() -> None:
    """A sine on a trend and noise, an uneven last step: to one line of the spectrum, 1 / 4 s."""
    times = np.append(np.arange(0.0, 4.0, 1e-3), 4.0004)
    random = np.random.default_rng(1)
    wave = (
        900.0 + 50.0 * times + 80.0 * np.sin(2.0 * np.pi * 7.3 * times) + random.normal(0.0, 20.0, len(times))
    )
    assert dominant_frequency_hz(times, wave) == pytest.approx(7.3, abs=0.25)
    slow = 900.0 + 80.0 * np.sin(2.0 * np.pi * 0.3 * times) + np.sin(2.0 * np.pi * 20.0 * times)
    assert np.isnan(dominant_frequency_hz(times, slow))  # drift is no vibration
    assert np.isnan(dominant_frequency_hz(times, np.cumsum(random.normal(size=len(times)))))  # nor is a walk
    assert np.isnan(dominant_frequency_hz(times[:5], wave[:5]))


def test_metrics_of_a_kept_run(tmp_path: Path) -> None:
    """Mean draft is the summary's; the peak of the 10 ms mean is below the raw one and above the mean."""
    found = scene()
    kept = keep_run(tmp_path, found, execute(found))
    metrics = metrics_of(kept)
    assert metrics["draft_mean_newton"] == pytest.approx(
        kept.summary["series"]["draft_newton"]["mean"], rel=1e-12
    )
    assert (
        metrics["draft_mean_newton"]
        < metrics["draft_peak_newton"]
        <= kept.summary["series"]["draft_newton"]["max"] * (1 + 1e-12)
    )
    assert "spring_range_newton" not in metrics
    assert "disturbed_area_m2" not in metrics


@pytest.mark.parametrize("row_s", [1e-3, 0.03])
def test_swing_is_that_of_a_sine(row_s: float) -> None:
    """7 Hz on a trend: the amplitude over sqrt(2), but for what a line takes of two periods (4 %)."""
    times = np.arange(0.0, 1.8, row_s)
    force = 5000.0 + 400.0 * times + 100.0 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 7.0 * times)
    assert swing(times, force) == pytest.approx(100.0, rel=0.08)


@pytest.mark.parametrize("fall_s", [0.5, 0.1, 0.03, 0.001])
def test_swing_is_not_a_fall(fall_s: float) -> None:
    """A bed that gives way once, slowly or at once, by 2 kN: 20 N of vibration stay 20 N, to a fifth."""
    times = np.arange(0.0, 1.8, 1e-3)
    force = 1000.0 * np.tanh((times - 0.9) / fall_s) + 20.0 * np.sqrt(2.0) * np.sin(14.0 * np.pi * times)
    assert swing(times, force) == pytest.approx(20.0, rel=0.2)


def test_swing_needs_rows() -> None:
    """Rows too far apart tell nothing of a vibration, nor do two periods of it."""
    times = np.arange(0.0, 1.8, 0.05)
    assert np.isnan(swing(times, np.sin(times)))
    short = np.arange(0.0, 0.4, 1e-3)
    assert np.isnan(swing(short, np.sin(short)))


def write_summary(folder: Path, start_s: float, end_s: float) -> None:
    """A summary that has nothing but its window."""
    found = {
        "schema_version": SCHEMA_VERSION,
        "scene": {"name": "", "hash": "", "allow": [], "note": ""},
        "run": {
            "id": "", "recorded": True, "complete": True, "simulated_s": end_s, "ticks": 1, "steps": 1,
            "wall_s": 1.0, "real_time_factor": 1.0,
        },
        "particles": {"count": 0, "lost_count": 0, "first_lost_s": None, "first_lost": []},
        "energy": {"residual_joule": 0.0, "residual_ratio": 0.0},
        "window": {"rule": "", "whole_run": False, "start_s": start_s, "end_s": end_s, "rows": 2},
        "series": {},
        "loads": {"vertical": {}, "power": {}, "specific": {}},
    }  # fmt: skip
    (folder / "summary.json").write_text(json.dumps(found))


def test_deviation_and_vertical_force_of_a_kept_run(tmp_path: Path) -> None:
    """A slow sine on a trend: its amplitude over sqrt(2); the forces on tillage tools add, a wheel's not."""
    times = np.arange(0.0, 4.0, 1e-3)
    wave = 1000.0 + 300.0 * times + 100.0 * np.sqrt(2.0) * np.sin(4.0 * np.pi * times)
    scene = "tools: {left: {}, right: {role: tillage}, wheel: {role: wheel}}\n"
    (tmp_path / "scene.yaml").write_text(scene)
    write_summary(tmp_path, 1.0, 3.0)
    names = ["draft_newton", *(f"tool.{tool}.force_z_newton" for tool in ("left", "right", "wheel"))]
    rows = "\n".join(f"{t:.6f},{f:.9f},{t:.6f},{-3 * t:.6f},50" for t, f in zip(times, wave, strict=True))
    (tmp_path / "series.csv").write_text(f"time_s,{','.join(names)}\n{rows}\n")
    metrics = metrics_of(CachedRun(tmp_path))
    assert metrics["draft_deviation_newton"] == pytest.approx(
        100.0, rel=0.03
    )  # a line takes 2 % of four periods
    assert metrics["vertical_mean_newton"] == pytest.approx(-4.0, rel=1e-3)


@pytest.mark.parametrize("end_s", [1.0, 1.001])
def test_a_window_of_one_or_two_rows_has_means_alone(tmp_path: Path, end_s: float) -> None:
    """No deviation and no frequency, rather than those of a line through the rows."""
    (tmp_path / "scene.yaml").write_text("tools: {tine: {}}\n")
    write_summary(tmp_path, 1.0, end_s)
    rows = "\n".join(f"{1e-3 * k:.3f},{100.0 + k % 2}" for k in range(2000))
    (tmp_path / "series.csv").write_text(f"time_s,draft_newton\n{rows}\n")
    metrics = metrics_of(CachedRun(tmp_path))
    assert 100.0 <= metrics["draft_mean_newton"] <= 101.0
    assert "draft_deviation_newton" not in metrics
    assert "draft_frequency_hz" not in metrics


def test_half_widths_are_those_of_the_record(tmp_path: Path) -> None:
    """Of a real run the mean's as in its summary, the deviation's as large a part of it; one tool's force."""
    found = scene()
    kept = keep_run(tmp_path, found, execute(found))
    metrics = metrics_of(kept)
    widths = half_widths_of(kept, metrics)
    draft = kept.summary["series"]["draft_newton"]["stationarity"]
    assert widths["draft_mean_newton"] == draft["mean_half_width"]
    assert widths["draft_deviation_newton"] / metrics["draft_deviation_newton"] == pytest.approx(
        draft["deviation_half_width"] / draft["deviation"]
    )
    vertical = kept.summary["series"]["tool.tine.force_z_newton"]["stationarity"]
    assert widths["vertical_mean_newton"] == vertical["mean_half_width"]


def test_range_and_swing_of_a_kept_run(tmp_path: Path) -> None:
    """Of the spring that the scene reports, over the window of the summary."""
    times = np.arange(0.0, 3.0, 1e-3)
    force = np.where(times < 0.9, 9000.0, 5000.0) + 100.0 * np.sqrt(2.0) * np.sin(14.0 * np.pi * times)
    (tmp_path / "scene.yaml").write_text("report: {spring: S}\n")
    write_summary(tmp_path, 1.0, 2.5)
    rows = "\n".join(f"{t:.6f},{f:.9f}" for t, f in zip(times, force, strict=True))
    (tmp_path / "series.csv").write_text(f"time_s,spring.S.force_newton\n{rows}\n")
    metrics = metrics_of(CachedRun(tmp_path))
    assert metrics["spring_detrended_std_newton"] == pytest.approx(100.0, rel=0.08)
    assert metrics["spring_range_newton"] == pytest.approx(200.0 * np.sqrt(2.0), rel=0.02)
