"""subsoil sweep with real Dask workers: a table, cached runs, failures that stop no other run, a cluster."""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest

from subsoil_ros.analysis.intervals import Interval
from subsoil_ros.analysis.summary import MEAN_DRAFT
from subsoil_ros.api.execution import execute
from subsoil_ros.cli.main import main
from subsoil_ros.experiments.run_sweep import Sweep
from subsoil_ros.experiments.sweep_points import Point, Variation
from subsoil_ros.experiments.sweep_ranking import (
    Ranked,
    control_point,
    point_key,
    rank,
    ranking_table,
    recommended,
)
from subsoil_ros.loading.loader import load_scene

Captured = pytest.CaptureFixture[str]
SCENES = Path(__file__).parents[2] / "config" / "scenes"
TINE = str(SCENES / "tine.yaml")
SOIL = f"soil={{model: wedge, file: {SCENES.parent / 'soils' / 'paper_grid.yaml'}}}"
COMMON = [SOIL, "duration_s=0.3", "record.series_ticks=3", "report.window_inside_m=0.0"]
TOO_FAST = "tools.tine.path.speed_x_m_per_s={kind: ramp, start_value: 0.5, end_value: 4.0, end_s: 0.3}"
DEPTH = "tools.tine.path.start_z_m"
BEYOND = '["beyond_fitted_range"]'
"""A value of `allow`, as tables write it."""
LIMIT_S = 120.0
"""No test waits longer for a process."""


def sweep(out: Path, *more: str) -> list[str]:
    """Arguments of a sweep of the tine on a wedge model: 300 ticks in a fraction of a second."""
    return ["sweep", TINE, *(word for item in COMMON for word in ("--set", item)), "--out", str(out), *more]


def until(condition: Callable[[], bool], what: str) -> None:
    """Waits for it."""
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline, f"waited {LIMIT_S:g} s for {what}"
        time.sleep(0.05)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two depths, two seeds, one of two runs of each beyond the soil's range: it fails."""
    out = tmp_path_factory.mktemp("sweep") / "out"
    vary = ["--vary", f"{DEPTH}=0.10,0.14", "--vary", "allow=[beyond_fitted_range],[]", "--seeds", "0,1"]
    assert main(sweep(out, *vary, "--set", TOO_FAST)) == 0
    return out


def test_table_has_every_run(done: Path) -> None:
    """CSV and Parquet hold the same bits: a row per run with values, seed and the numbers of its summary."""
    table = pd.read_csv(done / "sweep.csv", keep_default_na=False, na_values=[""])
    parquet = pd.read_parquet(done / "sweep.parquet")
    assert list(table.columns) == list(parquet.columns)
    assert len(table) == 8
    assert set(zip(parquet[DEPTH], parquet["allow"], parquet["seed"], strict=True)) == {
        (depth, beyond, seed) for depth in (0.10, 0.14) for beyond in (BEYOND, "[]") for seed in (0, 1)
    }
    whole = table["failure"].isna()
    means = table.loc[whole, ["metrics.draft_mean_newton", "series.draft_newton.mean"]].to_numpy()
    np.testing.assert_allclose(means[:, 0], means[:, 1], rtol=1e-12)
    assert table.loc[~whole, "metrics.draft_mean_newton"].isna().all()
    for name in ("series.draft_newton.mean", "series.draft_newton.run.max", "wall_s", DEPTH):
        pd.testing.assert_series_equal(table[name], parquet[name], check_exact=True)


def test_numbers_are_those_of_a_run_by_hand(done: Path) -> None:
    """A worker gives the bits that this process gives: the scene travelled whole."""
    table = pd.read_parquet(done / "sweep.parquet")
    row = table[(table[DEPTH] == 0.14) & (table["allow"] == BEYOND) & (table["seed"] == 1)].iloc[0]
    scene = load_scene(TINE, [*COMMON, TOO_FAST, f"{DEPTH}=0.14", f"allow={BEYOND}", "soil.seed=1"])
    executed = execute(scene)
    summary = json.loads(executed.files["summary.json"])
    assert summary["scene"]["allow"] == ["beyond_fitted_range"]
    assert row["run"] == scene.scene_hash[:32]
    assert row["series.draft_newton.mean"] == summary["series"]["draft_newton"]["mean"]
    assert (done / "runs" / row["run"] / "series.csv").read_bytes() == executed.files["series.csv"]


def test_failures_are_told_and_stop_nobody(done: Path) -> None:
    """Four runs failed, each with its message and what it had recorded; the others are whole."""
    table = pd.read_parquet(done / "sweep.parquet")
    failed = table[table["failure"] != ""]
    assert set(failed["allow"]) == {"[]"}
    assert len(failed) == 4
    assert failed["failure"].str.contains("the soil file was fitted up to").all()
    assert (done / "response.png").stat().st_size > 10_000
    assert len(pd.read_csv(done / "ranking.csv")) == 2  # of the points that have a draft


def test_what_is_kept_is_not_run_again(done: Path, tmp_path: Path, capsys: Captured) -> None:
    """The same call ends without a run; --retry-failed takes up the failed ones."""
    done = shutil.copytree(done, tmp_path / "copy")
    times = {path: path.stat().st_mtime_ns for path in done.glob("runs/*/run.json")}
    vary = ["--vary", f"{DEPTH}=0.10,0.14", "--vary", "allow=[beyond_fitted_range],[]", "--seeds", "0,1"]
    assert main(sweep(done, *vary, "--set", TOO_FAST)) == 0
    assert "8 runs, 8 of them kept" in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in done.glob("runs/*/run.json")} == times
    vary = ["--vary", f"{DEPTH}=0.10,0.14", "--vary", "allow=[]", "--seeds", "0"]
    assert main(sweep(done, *vary, "--set", TOO_FAST, "--retry-failed")) == 3
    printed = capsys.readouterr()
    assert "2 runs, 0 of them kept" in printed.err
    assert "every run failed" in printed.err
    changed = [path for path, before in times.items() if path.stat().st_mtime_ns != before]
    assert len(changed) == 2


@pytest.mark.full
def test_ctrl_c_keeps_what_is_done(tmp_path: Path) -> None:
    """A sweep that is interrupted exits with 130, leaves whole runs only, and goes on from there."""
    out = tmp_path / "out"
    arguments = sweep(out, "--vary", "soil.seed=" + ",".join(map(str, range(5))), "--workers", "1")
    arguments += ["--set", "duration_s=1.0"]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a shell's background
    process = subprocess.Popen(
        [sys.executable, "-m", "subsoil_ros.cli.main", *arguments],
        stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    signal.signal(signal.SIGINT, before)
    until(lambda: any(out.glob("runs/*/run.json")) or process.poll() is not None, "the first run")
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
    _, errors = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 130, errors
    kept = list(out.glob("runs/*/run.json"))
    assert 0 < len(kept) < 5
    assert {path.name for path in (out / "runs").iterdir()} == {path.parent.name for path in kept}
    until(lambda: not _of_session(process.pid), "its workers to end")
    again = subprocess.run(
        [sys.executable, "-m", "subsoil_ros.cli.main", *arguments],
        capture_output=True, text=True, timeout=LIMIT_S, check=True,
    )  # fmt: skip
    assert f"5 runs, {len(kept)} of them kept" in again.stderr
    assert len(pd.read_parquet(out / "sweep.parquet")) == 5


def _of_session(session: int) -> list[int]:
    """Processes of a session that still run."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getsid(process.pid) == session and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process.pid)
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
    return found


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen]]:
    """A scheduler and two workers as their own programs; (address, parent of the workers)."""
    file = tmp_path / "scheduler.json"
    (tmp_path / "elsewhere").mkdir()
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    strict = {
        **os.environ,
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0",
    }
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = subprocess.Popen(
        [*dask, "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)],
        env=strict,
        **quiet,
    )
    worker = None
    try:
        until(file.is_file, "the scheduler")
        until(lambda: file.read_text().strip().endswith("}"), "its address")
        worker = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file),
             "--nworkers", "2", "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard",
             "--local-directory", str(tmp_path / "elsewhere")],
            cwd=tmp_path / "elsewhere", env={**os.environ, "PYTHONPATH": str(SCENES.parents[1])}, **quiet,
        )  # fmt: skip
        yield json.loads(file.read_text())["address"], worker
    finally:
        for process in (worker, scheduler):
            if process is not None:
                process.terminate()
                process.wait(LIMIT_S)


def test_a_cluster_by_its_address(cluster: tuple[str, subprocess.Popen], tmp_path: Path) -> None:
    """Runs on another program's workers; one whose worker is killed is a failed run, the others run once."""
    address, worker = cluster
    out = tmp_path / "out"
    vary = [
        "--vary",
        "duration_s=60.0,0.3,0.4,0.5",
        "--set",
        f"allow={BEYOND}",
        "--set",
        "tools.tine.path.speed_x_m_per_s={kind: constant, value: 0.005}",
    ]
    process = subprocess.Popen(
        [sys.executable, "-m", "subsoil_ros.cli.main", *sweep(out, *vary, "--scheduler", address)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    nanny = psutil.Process(worker.pid)
    bags: dict[psutil.Process, set[str]] = defaultdict(set)  # of each worker, so far

    def second_run_of_one() -> bool:
        _note_bags(nanny, bags)
        return max(map(len, bags.values()), default=0) > 1 or process.poll() is not None

    until(second_run_of_one, "a worker's second run")
    for child, written in bags.items():
        if len(written) == 1:  # in the long run still
            child.kill()
    output, errors = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, errors
    table = pd.read_parquet(out / "sweep.parquet").set_index("duration_s")
    assert "the worker process that ran it died" in table.loc[60.0, "failure"]
    assert list(table.loc[[0.3, 0.4, 0.5], "failure"]) == ["", "", ""]
    assert "1 of 4 runs failed; --retry-failed" in output
    assert len(list((out / "runs").glob("*/summary.json"))) == 3


def _note_bags(nanny: psutil.Process, bags: dict[psutil.Process, set[str]]) -> None:
    """Add the bags that the workers under a nanny write now, by worker."""
    for child in nanny.children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            written = {file.path for file in child.open_files() if file.path.endswith(".mcap")}
            if written:
                bags[child] |= written


def test_runs_that_end_in_the_entry_are_not_ranked_as_steady(tmp_path: Path, capsys: Captured) -> None:
    """No row in the metrics window: said, and nothing recommended. A wrong --show keeps the table."""
    out = tmp_path / "out"
    short = ["--vary", "soil.seed=1,2", "--set", "duration_s=0.05", "--set", "report.window_inside_m=0.2"]
    assert main(sweep(out, *short, "--show", "series.nothing.mean")) == 2
    assert "the table beside them names the columns" in capsys.readouterr().err
    assert len(pd.read_csv(out / "sweep.csv")) == 2
    assert main(sweep(out, *short)) == 0
    printed = capsys.readouterr().out
    assert "WARNING: 2 of 2 runs have no row in their metrics window" in printed.replace("\n", " ")
    assert "nothing is recommended: runs have no row" in printed


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--vary: is missing"),
        (["--vary", "soil.sed=1,2"], "did you mean 'seed'"),
        (["--vary", "soil.seed=1,2", "--seeds", "3,4"], "--seeds: soil.seed is varied too"),
        (["--vary", "soil.seed=1,2", "--seeds", "0,x"], "--seeds 0,x: must be different whole numbers"),
        (["--vary", "soil.seed=1,2", "--scheduler", "tcp://127.0.0.1:9"], "no Dask scheduler answers there"),
        (["--vary", "soil.seed=1,2", "--workers", "0"], "'0' is no whole number"),
    ],
)
def test_bad_input(
    tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch, arguments: list[str], words: str
) -> None:
    """Exit status 2 with what is wrong, before anything runs."""
    monkeypatch.setattr("subsoil_ros.experiments.run_jobs.PATIENCE_S", 1.0)
    try:
        status = main(sweep(tmp_path / "out", *arguments))
    except SystemExit as error:  # argparse
        status = error.code
    assert status == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.glob("out/runs/*"))


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, capsys: Captured) -> None:
    """--out never writes into a folder that no sweep began."""
    (tmp_path / "notes.txt").write_text("mine")
    assert main(sweep(tmp_path, "--vary", "soil.seed=1,2")) == 2
    assert "has no sweep.yaml of an earlier call" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def rows(drafts: dict[tuple[str, float, int], float], fatigue: dict[float, float]) -> pd.DataFrame:
    """A table of made-up runs: (name, stiffness, seed) to draft, stiffness to fatigue load."""
    return pd.DataFrame(
        {
            "point": point_key(Point({"spring.stiffness": k} if name == "" else {}, name=name)),
            "name": name,
            "seed": seed,
            "failure": "",
            "series.draft_newton.mean": draft,
            "spring.fatigue.equivalent_range_newton": fatigue.get(k),
        }
        for (name, k, seed), draft in drafts.items()
    )


def made_up(*ranges: tuple[float, float, float]) -> tuple[pd.DataFrame, list[Point]]:
    """Points of (stiffness, draft, fatigue): a bed adds up to 30 N, a run 0.5 N; the control has 1000 N."""
    drafts = {("control", 0.0, seed): 1000.0 + 15.0 * seed for seed in range(3)}
    for place, (k, draft, _) in enumerate(ranges):
        for seed in range(3):
            noise = 0.5 * ((place + 2 * seed) % 3 - 1)
            drafts["", k, seed] = draft + 15.0 * seed + noise
    table = rows(drafts, {k: load for k, _, load in ranges})
    return table, [Point({"spring.stiffness": k}) for k, _, _ in ranges]


def test_ranking_is_by_draft_and_savings_are_paired() -> None:
    """Scatter of the beds drops out of the saving; equal drafts are told as such, the gentler is advised."""
    table, points = made_up(
        (1e5, 905.0, 800.0), (2e5, 900.0, 500.0), (4e5, 900.0, 300.0), (8e5, 950.0, 100.0)
    )
    ranked = rank(points, table, ["spring.locked=true"], None, 0.95)
    assert [item.values["spring.stiffness"] for item in ranked[2:]] == [1e5, 8e5]
    best = recommended(ranked)
    assert best is not None
    assert best.values == {"spring.stiffness": 4e5}
    assert best.saving is not None
    assert best.saving.mean == pytest.approx(100.0 / 1015.0, rel=0.01)
    assert best.saving.half_width < 0.003
    assert best.draft_newton.half_width > 30.0
    assert [item.level_with_best for item in ranked] == [True, True, False, False]


def test_the_best_is_best_on_the_seeds_that_all_have() -> None:
    """A bed that failed for one point raises the mean of the others, and a draft that is not known none."""
    table, points = made_up((1e5, 990.0, 1.0), (2e5, 985.0, 1.0), (4e5, 900.0, 1.0))
    bed = (table["seed"] == 2) & (table["name"] == "")
    table.loc[bed & (table["point"] == point_key(points[0])), "failure"] = "stopped"
    table.loc[bed & (table["point"] == point_key(points[1])), MEAN_DRAFT] = 1100.0
    table.loc[table["point"] == point_key(points[2]), MEAN_DRAFT] = math.nan
    ranked = rank(points, table, [], None, 0.95)
    assert [item.values["spring.stiffness"] for item in ranked] == [2e5, 1e5]
    assert ranked[1].behind_best.mean == pytest.approx(5.0, abs=1.0)


def test_columns_that_are_shown_stand_in_the_ranking() -> None:
    """Mean and half-width over the seeds; of keys whose values go together the first is drawn over."""
    table, points = made_up((1e5, 905.0, 800.0), (2e5, 900.0, 500.0))
    table["spring.largest"] = [2000.0, 2100.0, 2200.0] * 3
    ranked = rank(points, table, [], None, 0.95, ["spring.largest"])
    row = ranking_table(ranked, None).iloc[0]
    assert row["spring.largest"] == pytest.approx(2100.0)
    assert row["spring.largest_half_width"] == pytest.approx(4.303 * 100.0 / math.sqrt(3.0), rel=1e-3)
    depth, *springs = (Variation(key, (1, 2)) for key in ("depth", "stiffness", "damping"))
    assert Sweep("scene.yaml", (), (depth,), tuple(springs)).axes == ["depth", "stiffness"]


def test_nothing_is_recommended_without_proof() -> None:
    """Neither a saving within the scatter, nor a resolved cost, nor one of a single seed or of equal ones."""
    table, points = made_up((1e5, 1000.1, 1.0), (2e5, 1010.0, 1.0))
    assert recommended(rank(points, table, ["spring.locked=true"], None, 0.95)) is None
    table, points = made_up((1e5, 1100.0, 1.0), (2e5, 1150.0, 1.0))
    assert recommended(rank(points, table, ["spring.locked=true"], None, 0.95)) is None
    table, points = made_up((1e5, 900.0, 1.0), (2e5, 950.0, 1.0))
    assert recommended(rank(points, table[table["seed"] == 0], ["spring.locked=true"], None, 0.95)) is None
    column = "series.draft_newton.mean"
    table[column] = table.groupby("point")[column].transform("first")
    assert recommended(rank(points, table, ["spring.locked=true"], None, 0.95)) is None


def test_a_control_drops_what_it_makes_void() -> None:
    """Stiffness says nothing of a locked spring; depth does, so each depth has its control."""
    locked = ("mechanism.forces.s.locked=true",)
    points = [Point({"mechanism.forces.s.stiffness": k, "depth": d}) for k in (1, 2) for d in (3, 4)]
    controls = {point_key(control_point(point, locked)) for point in points}
    assert len(controls) == 2
    assert control_point(points[0], locked).values == {"depth": 3}
    soils = Point({"soil": "loam", "depth": 3})
    for control in ("soil=clay_loam", "soil.material=clay_loam", "gravity_m_per_s2=1"):
        kept = set(control_point(soils, (control,)).values)
        assert kept == ({"depth", "soil"} if control.startswith("gravity") else {"depth"})


def test_ranked_item_of_one_seed_is_not_told_apart() -> None:
    """level_with_best never claims a difference that has no interval."""
    item = Ranked({}, Interval(1.0, float("nan"), 1), None, Interval(5.0, float("nan"), 1), {}, 0)
    assert item.level_with_best
