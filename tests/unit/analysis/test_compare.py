"""subsoil compare: curves over one another, metrics and differences, and a measured CSV."""

import csv
import json
import shutil
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from subsoil_ros.analysis.series import read_series_csv
from subsoil_ros.analysis.stationarity import stationarity
from subsoil_ros.api.execution import execute
from subsoil_ros.cli.main import main
from subsoil_ros.experiments import tool_comparison
from subsoil_ros.experiments.run_cache import keep_run
from subsoil_ros.figures.comparison import Source, differences, labels_of, shared_span_s
from subsoil_ros.loading.loader import load_scene
from tests.unit.experiments.in_process import run_jobs_here

Captured = pytest.CaptureFixture[str]
SCENES = Path(__file__).parents[3] / "config" / "scenes"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The tine on a wedge model at two depths."""
    folder = tmp_path_factory.mktemp("runs")
    soil = f"soil={{model: wedge, file: {SCENES.parent / 'soils' / 'paper_grid.yaml'}}}"
    found = []
    for depth in (0.10, 0.12):
        scene = load_scene(
            SCENES / "tine.yaml",
            (soil, "duration_s=0.4", f"tools.tine.path.start_z_m={depth}", "record.series_ticks=5"),
        )
        found.append(keep_run(folder, scene, execute(scene)).folder)
    return found


def table(path: Path) -> dict[tuple[str, str], dict[str, float]]:
    """comparison.csv by column and statistic."""
    with path.open(newline="") as stream:
        return {
            (row.pop("column"), row.pop("statistic")): {key: float(value) for key, value in row.items()}
            for row in csv.DictReader(stream)
        }


def test_two_runs(runs: list[Path], tmp_path: Path, capsys: Captured) -> None:
    """Statistics are those of the summaries, differences are second minus first, the figure shows both."""
    out = tmp_path / "out"
    assert main(["compare", *map(str, runs), "--out", str(out)]) == 0
    one, two = (folder.name for folder in runs)
    found = table(out / "comparison.csv")
    first, second = (json.loads((folder / "summary.json").read_text()) for folder in runs)
    for statistic in ("mean", "min", "max"):
        row = found["draft_newton", statistic]
        assert row[one] == pytest.approx(first["series"]["draft_newton"][statistic], rel=1e-12)
        assert row[two] == pytest.approx(second["series"]["draft_newton"][statistic], rel=1e-12)
        assert row[f"difference {two}"] == row[two] - row[one]
    mean = found["draft_newton", "mean"]
    assert mean[f"part {two}"] == pytest.approx(mean[two] / mean[one] - 1.0)
    assert mean[two] < mean[one]  # the second stands 20 mm higher
    image = matplotlib.image.imread(out / "comparison.png")[:, :, :3]
    assert (np.ptp(image, axis=2) > 0.2).sum() > 400
    assert "draft_newton" in capsys.readouterr().out


def test_a_measurement(runs: list[Path], tmp_path: Path, capsys: Captured) -> None:
    """A field record that is the run plus 100 N is 100 N off, root mean square too, whatever its sampling."""
    series = read_series_csv(runs[0] / "series.csv")
    measured = tmp_path / "field.csv"
    lines = ["time_s,draft_newton,fuel_kg"]
    lines += [f"{t},{d + 100.0},1" for t, d in zip(series["time_s"], series["draft_newton"], strict=True)]
    measured.write_text("\n".join(lines) + "\n")
    out = tmp_path / "out"
    assert main(["compare", str(runs[0]), "--measured", str(measured), "--out", str(out)]) == 0
    found = table(out / "comparison.csv")
    assert found["draft_newton", "mean"]["difference field.csv"] == pytest.approx(100.0, rel=1e-9)
    assert found["draft_newton", "rms_difference"]["field.csv"] == pytest.approx(100.0, rel=1e-9)
    assert "fuel_kg" not in capsys.readouterr().out


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of scenes without Dask, whose use tests/system/test_sweep.py tests."""
    monkeypatch.setattr(tool_comparison, "run_jobs", run_jobs_here)


@pytest.mark.usefixtures("in_process")
def test_two_scenes_in_two_fields(runs: list[Path], tmp_path: Path, capsys: Captured) -> None:
    """Each scene runs with seeds 1 and 2; table, verdict and a page of one file; again, from what is kept."""
    out, names = tmp_path / "out", []
    for place, run in enumerate(runs):
        names.append(str(shutil.copy(run / "scene.yaml", tmp_path / f"t{place}.yaml")))
    words = ["compare", *names, "--seeds", "2", "--html", "--out", str(out)]
    for _ in range(2):
        assert main(words) == 0
        printed = capsys.readouterr().out
        assert "t1 - t0" in printed
        assert "over 2 fields" in printed
    assert len(list((out / "runs").iterdir())) == 4
    draft = table(out / "comparison.csv")["draft_newton", "mean_over_fields"]
    assert draft["t1"] < draft["t0"]
    page = (out / "comparison.html").read_text()
    assert "<h1>t1 against t0</h1>" in page
    assert "data:image/png;base64," in page
    assert "http" not in page.split("<body>")[1]
    assert main(["compare", *names, "--until", "90", "--out", str(out)]) == 0
    assert "over 3 fields" in capsys.readouterr().out  # with the least number of fields
    assert not (out / "comparison.html").exists()  # it was of two fields
    assert main(["compare", *names, "--out", str(tmp_path / "own")]) == 0
    assert "within these runs" in capsys.readouterr().out


def test_curves_of_other_times_are_compared_where_both_are() -> None:
    """x = t against x = t + 1, sampled elsewhere, ending earlier: 1 apart; a column of one alone is nan."""
    one = Source("one", {"time_s": np.linspace(0.0, 2.0, 21), "x_m": np.linspace(0.0, 2.0, 21)}, (0.5, 2.0))
    two = Source("two", {"time_s": np.array([0.0, 0.7, 1.5]), "x_m": np.array([1.0, 1.7, 2.5])}, (0.0, 1.5))
    found = {item.statistic: item.values for item in differences([one, two], ["x_m"])}
    assert found["rms_difference"] == pytest.approx((0.0, 1.0))
    assert found["mean"] == pytest.approx((1.25, 5.2 / 3.0))
    alone = differences([one, Source("three", {"time_s": two.columns["time_s"]}, (0.0, 1.5))], ["x_m"])
    assert all(np.isnan(item.values[1]) for item in alone)


def test_waves_that_runs_share_leave_their_difference_known() -> None:
    """The same slow wave in both, 5 more in the second with noise of 1 N: 5 within Student's interval of the
    noise, whatever the wave; only times in both spans count."""
    times = np.arange(1000) * 0.01
    noise = np.random.default_rng(1).normal(size=1000)
    wave = 100.0 * np.sin(0.9 * times)
    one = Source("one", {"time_s": times, "x_m": wave}, (0.0, 8.0))
    two = Source("two", {"time_s": times[50:], "x_m": (wave + 5.0 + noise)[50:]}, (0.0, 20.0))
    found = {item.statistic: item for item in differences([one, two], ["x_m"])}
    mean = found["shared_mean"]
    assert shared_span_s([one, two]) == (0.5, 8.0)
    assert mean.values[0] == pytest.approx(wave[50:801].mean(), rel=1e-12)
    assert mean.half_widths[0] == 0.0
    assert mean.half_widths[1] == pytest.approx(2.31 / np.sqrt(751), rel=0.6)  # t of 8 waves, noise of 1
    assert abs(mean.against_first(1)[0] - 5.0) < mean.half_widths[1]
    assert mean.part_half_widths[0] == 0.0
    ratio = mean.values[1] / mean.values[0]
    found_part = stationarity(times[50:801], (wave + 5.0 + noise)[50:801] - ratio * wave[50:801])
    assert mean.part_half_widths[1] == pytest.approx(found_part.mean_half_width / abs(mean.values[0]))
    assert found["shared_deviation"].values[0] == pytest.approx(
        np.std(wave[50:801] - np.polyval(np.polyfit(times[50:801], wave[50:801], 1), times[50:801]))
    )


def test_runs_without_shared_times_have_no_shared_mean() -> None:
    """The other statistics are still reported."""
    one, two = (
        Source(name, {"time_s": np.arange(9.0), "x_m": np.arange(9.0)}, span)
        for name, span in (("one", (0.0, 3.0)), ("two", (5.0, 8.0)))
    )
    found = {item.statistic: item.values for item in differences([one, two], ["x_m"])}
    assert found["mean"] == (1.5, 6.5)
    assert np.isnan([*found["shared_mean"], *found["shared_deviation"]]).all()


def test_missing_values_are_left_out_of_shared_times() -> None:
    """A nan in a measured column: the curve is linear over the gap."""
    times = np.arange(100.0)
    holes = np.where(times % 7 == 3, np.nan, times)
    one = Source("one", {"time_s": times, "x_m": times}, (0.0, 99.0))
    two = Source("two", {"time_s": times, "x_m": holes + 1.0}, (0.0, 99.0), measured=True)
    found = {item.statistic: item for item in differences([one, two], ["x_m"])}
    assert found["shared_mean"].against_first(1)[0] == pytest.approx(1.0)


def test_values_end_where_they_are_known() -> None:
    """A measured column that ends early, and one of two rows: nothing is continued past the last value."""
    times = np.arange(100.0)
    ends = np.where(times <= 40.0, times + 1.0, np.nan)
    one = Source("one", {"time_s": times, "x_m": times}, (0.0, 99.0))
    two = Source("two", {"time_s": times, "x_m": ends}, (0.0, 99.0), measured=True)
    found = {item.statistic: item for item in differences([one, two], ["x_m"])}
    assert found["rms_difference"].values[1] == pytest.approx(1.0)
    assert found["shared_mean"].values == pytest.approx((20.0, 21.0))
    few = Source("few", {"time_s": np.array([10.0, 60.0]), "x_m": np.array([11.0, 61.0])}, (0.0, 99.0))
    found = {item.statistic: item for item in differences([one, few], ["x_m"])}
    assert found["rms_difference"].values[1] == pytest.approx(1.0)
    assert np.isnan(found["shared_mean"].values[1])


def test_a_run_that_ends_in_the_entry_is_said_to(runs: list[Path], tmp_path: Path, capsys: Captured) -> None:
    """No row in its metrics window: a warning, as run and report give one."""
    short = tmp_path / "short"
    shutil.copytree(runs[1], short)
    summary = json.loads((short / "summary.json").read_text())
    summary["window"]["whole_run"] = True
    (short / "summary.json").write_text(json.dumps(summary))
    assert main(["compare", str(runs[0]), str(short), "--out", str(tmp_path / "out")]) == 0
    assert "WARNING: short: no row lies in its metrics window" in capsys.readouterr().out


def test_labels_are_as_short_as_they_can_be() -> None:
    """Folder names, with parents where they are equal."""
    assert labels_of([Path("/a/x"), Path("/a/y")]) == ["x", "y"]
    assert labels_of([Path("/a/x"), Path("/b/x")]) == ["a/x", "b/x"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{run}"], "is one run; name a second one"),
        (["{run}", "{run}"], "is named twice"),
        (["{run}", "{tmp}"], "no folder of a run"),
        (["{run}", "--measured", "{tmp}/none.csv"], "none.csv: cannot be read"),
        (["{run}", "--measured", "{tmp}/other.csv"], "no column is one of the runs'"),
        (["{run}", "--measured", "{tmp}/back.csv"], "time_s does not grow"),
        (["{run}", "--measured", "{tmp}/timeless.csv"], "time_s does not grow"),
        (["{run}", "{other}", "--show", "draft_newtn"], "did you mean 'draft_newton'"),
        (["{run}", "tine"], "tine is a scene; run the scene first, or name {run}/scene.yaml"),
        (["{run}", "{other}", "--seeds", "3"], "--seeds: given with folders of runs"),
        (["{run}", "{other}", "--preset", "coarse"], "--set, --preset: given with folders of runs"),
        (["tine", "{tmp}/none.yaml"], "none.yaml: is no folder of a run and no scene"),
        (["tine", "mechanism_only"], "mechanism_only: has no tool in soil"),
        (["tine", "{tmp}/tine.yaml"], "two of them are the same scene"),
        (["tine", "tine"], "is named twice"),
        (["tine", "field_tine", "--seeds", "2", "--measured", "x.csv"], "--seeds or --until: given with --m"),
        (["tine", "field_tine", "--until", "3", "--seeds", "2"], "--until begins with 3 fields"),
    ],
)
def test_bad_input(
    runs: list[Path], tmp_path: Path, capsys: Captured, arguments: list[str], words: str
) -> None:
    """Exit status 2, one message, nothing written."""
    (tmp_path / "other.csv").write_text("time_s,draft_kn\n0,1\n1,2\n")
    (tmp_path / "back.csv").write_text("time_s,draft_newton\n1,1\n0,2\n")
    (tmp_path / "timeless.csv").write_text("time_s,draft_newton\nnan,1\n0.2,2\n")
    (tmp_path / "tine.yaml").write_text(f"base: {SCENES / 'tine.yaml'}\n")
    filled = [item.format(run=runs[0], other=runs[1], tmp=tmp_path) for item in arguments]
    assert main(["compare", *filled, "--out", str(tmp_path / "out")]) == 2
    assert words.format(run=runs[0]) in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
