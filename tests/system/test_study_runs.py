"""A real study in miniature, its runs in processes of their own."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from subsoil_ros.api.execution import RunResult, execute
from subsoil_ros.cli.main import main
from subsoil_ros.cli.progress import SweepProgress
from subsoil_ros.experiments.run_cache import keep_run
from subsoil_ros.experiments.run_jobs import ExecutionOptions, run_jobs
from subsoil_ros.experiments.sweep_points import Point, jobs_of
from subsoil_ros.loading.presets import read_preset
from tests.unit.experiments.designs import TINY

Captured = pytest.CaptureFixture[str]
CONFIG = Path(__file__).parents[2] / "config"


@pytest.mark.full
def test_a_run_that_nobody_timed_runs_again_in_a_study(tmp_path: Path, capsys: Captured) -> None:
    """A benchmark's, say, has no CPU time; a sweep takes it as it is, a study times it."""
    soil = f"soil={{model: wedge, file: {CONFIG / 'soils' / 'paper_grid.yaml'}}}"
    jobs = jobs_of(str(CONFIG / "scenes" / "tine.yaml"), [soil, "duration_s=0.01"], [Point({})])
    done = execute(jobs[0].scene)
    keep_run(tmp_path, jobs[0].scene, RunResult(done.files, {**done.facts, "wall_s": None, "cpu_s": None}))
    for timed, kept in ((False, 1), (True, 0), (True, 1)):
        with SweepProgress("study") as progress:
            found = run_jobs(jobs, tmp_path, ExecutionOptions(workers=1, timed=timed), progress)
        assert f"1 runs, {kept} of them kept" in capsys.readouterr().err
        assert (found[0].facts["cpu_s"] is not None) == timed


def test_a_study_of_real_runs(tmp_path: Path, capsys: Captured) -> None:
    """Particles and wedge model, two beds: table, figure, presets; a factor that fails is told."""
    path, out = tmp_path / "design.yaml", tmp_path / "out"
    path.write_text(yaml.safe_dump(TINY, sort_keys=False))
    scene = str(CONFIG / "scenes" / "tine.yaml")
    arguments = ["study", scene, "--design", str(path), "--out", str(out)]
    assert main(arguments) == 0
    table = pd.read_parquet(out / "study.parquet").set_index("preset")
    assert list(table.index) == [
        "reference", "soil_step: auto", "soil_step: same", "overlap: none allowed", "soil: wedge", "coarse",
    ]  # fmt: skip
    assert table.loc["overlap: none allowed", "failures"] == 2
    assert (table.loc["soil_step: same", "draft_mean_newton_verdict"]) == "same"
    auto = table.loc["soil_step: auto"]
    by_run = pd.read_parquet(out / "runs.parquet").set_index(["name", "seed"])
    assert (by_run["at_once"] == 1).all()
    drafts = {
        name: np.array([by_run.loc[(name, s), "series.draft_newton.mean"] for s in (0, 1)])
        for name in ("reference", "soil_step: auto")
    }
    assert len(set(drafts["reference"])) == 2  # another seed is another bed
    error = (drafts["soil_step: auto"] - drafts["reference"]).mean() / drafts["reference"].mean()
    assert auto["draft_mean_newton_error"] == pytest.approx(error, rel=1e-9)
    assert table.loc["coarse", "draft_mean_newton_error"] == auto["draft_mean_newton_error"]
    expected = yaml.safe_load((out / "expected.yaml").read_text())
    preset = read_preset(expected["coarse"], "expected.yaml: coarse")
    assert preset.expected is not None
    assert preset.expected.errors["draft_mean_newton"].mean == pytest.approx(error, rel=1e-9)
    scatter = read_preset(expected["reference"], "expected.yaml: reference").expected
    assert scatter is not None
    true = drafts["reference"]
    of_two = 12.706 * abs(np.diff(true)[0]) / 2.0 / true.mean()  # t(1) s / sqrt(2)
    assert scatter.errors["draft_mean_newton"].high == pytest.approx(of_two, rel=1e-4)
    assert (out / "study.png").stat().st_size > 10_000
    capsys.readouterr()
    assert main(arguments) == 0
    printed = capsys.readouterr()
    assert "8 runs, 8 of them kept" in printed.err
    assert "overlap: none allowed" in printed.out
