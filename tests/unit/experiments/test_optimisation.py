"""subsoil optimise: proposals that are the same again, a least value that is found, failures, bad input."""

from pathlib import Path

import pandas as pd
import pytest

from subsoil_ros.cli.main import main
from subsoil_ros.experiments import optimisation
from subsoil_ros.experiments.sweep_points import Point, jobs_of
from subsoil_ros.loading.loader import load_scene
from tests.unit.experiments.in_process import run_jobs_here

Captured = pytest.CaptureFixture[str]
RAKE = "tools.tine.blade.rake_deg"
DRAFT = "series.draft_newton.mean"


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A blade on a wedge model, whose runs take a moment and this process."""
    monkeypatch.setattr(optimisation, "run_jobs", run_jobs_here)
    soil = load_scene("tine").directory.parent / "soils" / "paper_grid.yaml"
    path = tmp_path / "blade.yaml"
    path.write_text(
        f"name: blade\nduration_s: 0.3\nsoil: {{model: wedge, file: {soil}, "
        "bin: {length_m: 0.6, width_m: 0.25, depth_m: 0.27}}\n"
        "tools: {tine: {blade: {rake_deg: 40, width_m: 0.06, height_m: 0.4}, path: "
        "{start_x_m: -0.05, start_z_m: -0.2, speed_x_m_per_s: 0.5}}}\nreport: {window_inside_m: 0.0}\n",
        encoding="utf-8",
    )
    return path


def test_the_least_draft_is_found_and_can_be_run(scene: Path, tmp_path: Path, capsys: Captured) -> None:
    """A flat rake draws least. More trials begin with the same runs; best.yaml is the scene of the best."""
    out = tmp_path / "out"
    words = ["optimise", str(scene), "--vary", f"{RAKE}=26,42", "--seeds", "1", "--out", str(out)]
    assert main([*words, "--trials", "4"]) == 0
    first = pd.read_csv(out / "trials.csv")
    assert main([*words, "--trials", "16"]) == 0
    table = pd.read_csv(out / "trials.csv")
    pd.testing.assert_frame_equal(table[:4], first)
    assert len(list((out / "runs").iterdir())) == len(table) == 16
    best = table.loc[table[DRAFT].idxmin()]
    assert best[RAKE] == table[RAKE].min() < 29.0
    assert load_scene(out / "best.yaml", ["soil.seed=1"]).scene_hash.startswith(best["run"])
    printed = capsys.readouterr().out
    assert f"subsoil compare {scene} {out / 'best.yaml'}" in printed.replace("\n", "")


def test_a_tool_that_never_comes_in_is_no_best(scene: Path, tmp_path: Path, capsys: Captured) -> None:
    """Its mean would be of the way through air. What all runs have, the command for the best gives too."""
    out, start = tmp_path / "out", "tools.tine.path.start_x_m"
    window = "report={tip_m: [0.0, 0.0], window_inside_m: 0.05}"
    words = ["optimise", str(scene), "--vary", f"{start}=-0.3,-0.02", "--trials", "6", "--set", window]
    assert main([*words, "--out", str(out)]) == 0
    table = pd.read_csv(out / "trials.csv", keep_default_na=False)
    lacks = table["failure"].str.startswith("no row lies in its metrics window")
    assert 0 < lacks.sum() < len(table)
    best = load_scene(out / "best.yaml").document["tools"]["tine"]["path"]["start_x_m"]
    assert best == table.loc[~lacks, start][table.loc[~lacks, DRAFT].astype(float).idxmin()]
    assert (out / "best.yaml").read_text().startswith(f"# found with --set '{window}', which this file has")
    printed = "".join(capsys.readouterr().out.split())
    assert f"--presetstandard--set'{window}'--seeds3".replace(" ", "") in printed


def test_a_scene_in_short_needs_no_name(scene: Path, tmp_path: Path) -> None:
    """It is that of the searched file, also in best.yaml."""
    blade = "{blade: {rake_deg: 30, width_m: 0.06}, depth_m: 0.2, speed_m_per_s: 0.5}"
    scene.write_text(f"soil: loam\ntravel_m: 1.5\npreset: real_time\ntools: {{tine: {blade}}}\n")
    words = ["optimise", str(scene), "--vary", f"{RAKE}=28,34", "--trials", "1"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    assert load_scene(tmp_path / "out" / "best.yaml").scene.name == "blade"


def test_names_with_a_dot(tmp_path: Path, capsys: Captured) -> None:
    """A start value keeps its name, shank.angle_rad; an initial condition would win over it in a file."""
    scene, key = "subsoiler_1s300_wedge", "mechanism.initial.coordinates.shank.angle_rad"
    wanted = optimisation.Search(scene, (), (optimisation.Range(key, 0.0, 0.1),), DRAFT, 1)
    (job,) = jobs_of(scene, (), [Point({key: 0.05})])
    document = optimisation._scene(wanted, {key: 0.07}, job)
    assert document["mechanism"] == {"initial": {"coordinates": {"shank.angle_rad": 0.07}}}
    words = ["optimise", scene, "--vary", f"{key}=0,0.1", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "search a scene with initial_condition: null" in " ".join(capsys.readouterr().err.split())


def test_without_a_point_that_runs(scene: Path, tmp_path: Path, capsys: Captured) -> None:
    """Too fast for the wedge model: an error with the first message; the table has them all."""
    fast = "tools.tine.path.speed_x_m_per_s={kind: ramp, start_value: 0.5, end_value: 4.0, end_s: 0.3}"
    words = ["optimise", str(scene), "--vary", f"{RAKE}=26,42", "--trials", "2", "--set", fast]
    assert main([*words, "--out", str(tmp_path / "out")]) == 3
    assert "no point has all its runs" in capsys.readouterr().err
    assert (pd.read_csv(tmp_path / "out" / "trials.csv")["failure"].str.len() > 0).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--vary: is missing"),
        (["--vary", f"{RAKE}=42,26"], "must be two numbers, LEAST,LARGEST"),
        (["--vary", f"{RAKE}=26,30,42"], "must be two numbers, LEAST,LARGEST"),
        (["--vary", "tools.tine.blade.rake=26,42"], "did you mean 'rake_deg'"),
        (["--vary", f"{RAKE}=5,42"], "clearance_deg: given 10, must be below rake_deg 5"),
        (["--vary", f"{RAKE}=26,42", "--trials", "2", "--least", "draft"], "--least draft: no such column"),
    ],
)  # fmt: skip
def test_bad_input(scene: Path, tmp_path: Path, capsys: Captured, arguments: list[str], words: str) -> None:
    """Exit status 2 and one message."""
    assert main(["optimise", str(scene), *arguments, "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
