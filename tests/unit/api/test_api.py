"""The front door: load, check, run and read a scene from Python."""

import json
import shutil
import signal
import tempfile
import threading
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import subsoil_ros as subsoil
from subsoil_ros.cli.main import main
from subsoil_ros.errors import InputError, InterruptedRunError, RecordingError, RunError, SceneError
from subsoil_ros.loading.loader import ResolvedScene

CONFIG = Path(__file__).parents[3] / "config"
TICKS = 300
REDUCED = {
    "soil": {"model": "wedge", "file": str(CONFIG / "soils" / "paper_grid.yaml")},
    "duration_s": 0.3,
    "record.series_ticks": 3,
    "report.window_inside_m": 0.0,
}
DIFFERS = {"id", "wall_s", "whole_wall_s", "real_time_factor", "checkpoint", "resumed_from"}
"""Keys of a summary's `run` that two equal runs need not share."""


@pytest.fixture
def scene() -> ResolvedScene:
    """The tine on a wedge model: 300 ticks in a fraction of a second."""
    return subsoil.load_scene("tine", REDUCED)


def comparable(summary: dict[str, Any]) -> dict[str, Any]:
    """A summary without what differs from run to run."""
    return summary | {"run": {key: value for key, value in summary["run"].items() if key not in DIFFERS}}


def test_a_run_in_memory_is_that_of_the_command(scene: ResolvedScene, tmp_path: Path) -> None:
    """Series and summary of `subsoil run --mode direct`, bit for bit; and of a run into a folder."""
    scene.write(tmp_path / "scene.yaml")
    command = ["run", str(tmp_path / "scene.yaml"), "--mode", "direct", "--out", str(tmp_path / "command")]
    assert main(command) == 0
    theirs = subsoil.read_run(tmp_path / "command")
    ours = subsoil.run(scene, tmp_path / "folder")
    in_memory = subsoil.run(scene)
    for found in (ours, in_memory):
        pd.testing.assert_frame_equal(found.series, theirs.series, check_exact=True)
        assert comparable(found.summary) == comparable(theirs.summary)
        assert found.scene is scene
        assert found.failure is None
    assert (ours.folder, in_memory.folder) == (tmp_path / "folder", None)
    assert repr(in_memory) == "<Run of 'tine', in memory, complete>"
    names = {path.name for path in (tmp_path / "command").iterdir()}
    assert {path.name for path in (tmp_path / "folder").iterdir()} == names


def test_a_document_runs_as_its_file(scene: ResolvedScene) -> None:
    """The same hash as the file it was read from; a document is not changed."""
    document = json.loads(json.dumps(scene.document))
    assert subsoil.load_scene(document).scene_hash == scene.scene_hash
    assert document == scene.document


def test_progress_counts_every_tick(scene: ResolvedScene) -> None:
    """From 1 to the number of ticks."""
    seen: list[tuple[int, int]] = []
    subsoil.run(scene, progress=lambda done, count: seen.append((done, count)))
    assert seen == [(done, TICKS) for done in range(1, TICKS + 1)]


def interrupt_at(tick: int, *, by_signal: bool) -> Any:
    """A progress callback that ends the run after some ticks, as Ctrl-C does or by its exception."""

    def progress(done: int, count: int) -> None:
        if done == tick and by_signal:
            signal.raise_signal(signal.SIGINT)
        elif done == tick:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("by_signal", [True, False])
def test_an_interrupted_run_can_go_on(scene: ResolvedScene, tmp_path: Path, by_signal: bool) -> None:
    """The folder has a readable bag, results and a checkpoint; from there it ends as one never stopped."""
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(InterruptedRunError, match=r"ended by SIGINT; checkpoint: .*--resume") as caught:
        subsoil.run(scene, tmp_path / "first", progress=interrupt_at(100, by_signal=by_signal))
    assert signal.getsignal(signal.SIGINT) is before
    first = subsoil.read_run(tmp_path / "first")
    assert first.failure == str(caught.value)
    assert not first.summary["run"]["complete"]
    assert len(first.series) == 34
    second = subsoil.run(scene, tmp_path / "second", resume=tmp_path / "first")
    whole = subsoil.run(scene)
    pd.testing.assert_frame_equal(second.series, whole.series, check_exact=True)
    assert second.summary["run"]["state_sha256"] == whole.summary["run"]["state_sha256"]
    assert subsoil.run(scene, resume=tmp_path / "first").series.equals(whole.series)


def test_an_interrupted_run_in_memory_leaves_nothing(
    scene: ResolvedScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does one that ends well, or whose callback fails; no message names what is gone."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(InterruptedRunError) as caught:
        subsoil.run(scene, progress=interrupt_at(100, by_signal=True))
    assert str(caught.value) == "ended by SIGINT"
    with pytest.raises(ZeroDivisionError):
        subsoil.run(scene, progress=lambda done, count: 1 // 0)
    assert "checkpoint" not in subsoil.run(scene).summary
    assert not list(tmp_path.iterdir())


def test_a_run_after_whose_last_tick_ctrl_c_comes_is_whole(scene: ResolvedScene, tmp_path: Path) -> None:
    """Its results are written before the interrupt goes on."""
    with pytest.raises(KeyboardInterrupt):
        subsoil.run(scene, tmp_path / "out", progress=interrupt_at(TICKS, by_signal=True))
    assert subsoil.read_run(tmp_path / "out").summary["run"]["complete"]


def test_a_run_in_a_thread(scene: ResolvedScene, tmp_path: Path) -> None:
    """The same bits, no signal handler; the callback interrupts it."""
    found: list[Any] = []

    def work() -> None:
        found.append(subsoil.run(scene))
        try:
            subsoil.run(scene, tmp_path / "out", progress=interrupt_at(50, by_signal=False))
        except InterruptedRunError as error:
            found.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found[0].series.equals(subsoil.run(scene).series)
    assert "checkpoint: " in str(found[1])


def test_a_run_that_fails_leaves_its_results(tmp_path: Path) -> None:
    """The error names what happened; the folder holds the series up to there."""
    fast = {"kind": "ramp", "start_value": 0.5, "end_value": 4.0, "end_s": 0.3}
    overrides = {**REDUCED, "tools.tine.path.speed_x_m_per_s": fast}
    with pytest.raises(RunError, match="m/s fast, the soil file was fitted up to"):
        subsoil.run("tine", tmp_path / "out", overrides=overrides)
    found = subsoil.read_run(tmp_path / "out")
    assert "m/s fast" in str(found.failure)
    assert 0 < len(found.series) < 100


def test_a_run_that_records_nothing_has_no_series() -> None:
    """It has a summary, and the series says how to get one."""
    found = subsoil.run("tine", overrides={**REDUCED, "record.bag": False})
    assert found.summary["run"]["complete"]
    with pytest.raises(InputError, match=r"record\.bag: true"):
        found.series  # noqa: B018


@pytest.mark.parametrize(
    ("given", "overrides", "words"),
    [
        ("tine", {"soil.bed.sead": 3}, r"^overrides: soil\.bed\.sead: no key 'sead'.*seed"),
        ("tine", {"duration_s": "long"}, r"given the text 'long'.*\(given by overrides: duration_s\)"),
        (
            "tine",
            {"duration_s": object()},
            r"^overrides: duration_s: cannot represent an object: .*; allowed are numbers",
        ),
        ("tine", {"duration_s": float("nan")}, r"^overrides: duration_s: given nan"),
        ("tine", {"soil..seed": 3}, r"^overrides: given the key 'soil\.\.seed'; it must be KEY\.KEY"),
        ("tine", {"preset": "best"}, r"^overrides: preset: no preset 'best'"),
        ("tinne", {}, r"^tinne: no such file.*did you mean 'tine'"),
        ({"name": "x", "duration_z": 1.0}, {}, r"scene: duration_z: unknown key"),
        (3, {}, r"^scene: given a int; give the name"),
    ],
)
def test_what_cannot_be_loaded(given: Any, overrides: dict[str, object], words: str) -> None:
    """One message with place, given and allowed values."""
    with pytest.raises(InputError, match=words):
        subsoil.load_scene(given, overrides)


def test_arguments_of_a_run_are_checked(scene: ResolvedScene, tmp_path: Path) -> None:
    """Nothing is written, and what is there stays."""
    with pytest.raises(InputError, match=r"^overrides: the scene has been loaded already"):
        subsoil.run(scene, overrides={"duration_s": 1.0})
    with pytest.raises(InputError, match=r"^threads: given 0; it must be"):
        subsoil.run(scene, threads=0)
    with pytest.raises(InputError, match="exists already"):
        subsoil.run(scene, tmp_path)
    with pytest.raises(InputError, match=r"^resume .*nowhere: no such folder"):
        subsoil.run(scene, tmp_path / "out", resume=tmp_path / "nowhere")
    external = {"controller.law": {"kind": "external"}}
    with pytest.raises(InputError, match="a direct run has no nodes"):
        subsoil.run("subsoiler_1s300_draft_limit", tmp_path / "out", overrides=external)
    assert not list(tmp_path.iterdir())


def test_reading_what_is_not_whole(scene: ResolvedScene, tmp_path: Path) -> None:
    """Series and summary come from the bag where their files are not there, and of a bag alone."""
    out = tmp_path / "out"
    whole = subsoil.run(scene, out)
    (out / "series.csv").unlink()
    assert subsoil.read_run(out).series.equals(whole.series)
    (out / "summary.json").unlink()
    assert subsoil.read_run(out).summary["series"] == whole.summary["series"]
    shutil.copytree(out / "bag", tmp_path / "alone")
    alone = subsoil.read_run(tmp_path / "alone")
    assert alone.series.equals(whole.series)
    assert (alone.folder, alone.scene.scene_hash) == (None, scene.scene_hash)


def test_what_cannot_be_read(scene: ResolvedScene, tmp_path: Path) -> None:
    """No folder, a folder that is no run, a damaged summary, a damaged bag: each with its cure."""
    with pytest.raises(InputError, match="nowhere: no such folder; give one that `subsoil run` made"):
        subsoil.read_run(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"no bag there.*it has no scene\.yaml"):
        subsoil.read_run(tmp_path)
    out = tmp_path / "out"
    subsoil.run(scene, out)
    (out / "summary.json").write_text("{")
    with pytest.raises(InputError, match=r"summary\.json: cannot be read .*`subsoil report "):
        subsoil.read_run(out)
    (out / "summary.json").write_text("{}")
    with pytest.raises(
        InputError, match=r"summary\.json: is no summary of schema_version 2; `subsoil report "
    ):
        subsoil.read_run(out)
    (out / "summary.json").unlink()
    (out / "series.csv").unlink()
    bag = next((out / "bag").glob("*.mcap"))
    bag.write_bytes(bag.read_bytes()[:-200])
    with pytest.raises(RecordingError, match="`subsoil bag recover "):
        subsoil.read_run(out)


def test_check_says_what_a_run_would_be(scene: ResolvedScene) -> None:
    """Particles, limits, cost and warnings of a bed of particles; none of them on a wedge model."""
    found = subsoil.check("tine", {"duration_s": 0.2})
    assert found.particles == 6930
    assert found.limits[0].limit_s == min(limit.limit_s for limit in found.limits)
    assert found.scene.timing.soil_step_s <= found.limits[0].limit_s
    assert found.cost.soil_wall_s == 2.0 * subsoil.check("tine", {"duration_s": 0.1}).cost.soil_wall_s
    assert found.warnings == ()
    assert "particles: 6,930\nsoil step: 32 us" in str(found)
    wedge = subsoil.check(scene)
    assert (wedge.particles, wedge.limits, wedge.cost.soil_wall_s) == (0, (), 0.0)
    with pytest.raises(SceneError, match="overlap so far that they would be shot apart"):
        subsoil.check("tine", {"soil.bed.spacing_m": 0.005})
