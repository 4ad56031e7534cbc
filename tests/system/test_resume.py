"""A run that is ended somewhere and goes on gives the bits of one that was not: series, bag, full state."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.cli.main import main
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.recording import checkpoint
from subsoil_ros.recording.checkpoint import end_digests, read_checkpoint
from subsoil_ros.recording.joined import open_record
from tests.system.conftest import LIMIT_S, SCENE, Run, messages, run_arguments, wait_until_gone
from tests.system.test_controller import CHANGES, CONTROL, LATCHED_IN_BAG
from tests.system.test_modes import without_wall_time

DURATION_S = 0.06
EVERY = ("--set", "record.checkpoint_s=0.005")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run that nothing happens to."""
    run = Run(tmp_path_factory.mktemp("whole") / "out", "direct", DURATION_S, *EVERY)
    status, _, err = run.finish()
    assert status == 0, err
    return run.out


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Run]]:
    """Starts a run, and leaves nothing of it."""
    runs: list[Run] = []

    def start(name: str, mode: str, *more: str) -> Run:
        runs.append(Run(tmp_path / name, mode, DURATION_S, *EVERY, *more))
        return runs[-1]

    yield start
    for run in runs:
        run.end(run.node_pids())


def wait_for_checkpoint(run: Run) -> None:
    """Until the first one is valid."""
    deadline = time.monotonic() + LIMIT_S
    while not list(run.out.glob("checkpoints/*/manifest.json")):
        assert run.process.poll() is None, run.process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)


def summary(out: Path) -> dict:
    """What the run says of itself."""
    return json.loads((out / "summary.json").read_text())["run"]


def joined(first: Path, second: Path) -> list[tuple[str, int, bytes]]:
    """Messages of both bags as of one run: of the first only those up to the checkpoint."""
    end_ns = json.loads((second / "resumed_from.json").read_text())["end_time_ns"]
    before = [item for item in without_wall_time(first) if item[1] <= end_ns]
    return before + [item for item in without_wall_time(second) if item[0] not in LATCHED_IN_BAG]


def assert_same(whole: Path, first: Path, second: Path) -> None:
    """Series, every message and the full state at the end."""
    assert (second / "series.csv").read_bytes() == (whole / "series.csv").read_bytes()
    assert joined(first, second) == without_wall_time(whole)
    assert summary(second)["state_sha256"] == summary(whole)["state_sha256"]
    assert sorted(summary(whole)["state_sha256"]) == ["coupling", "mechanism", "soil"]


@pytest.mark.full
@pytest.mark.parametrize("mode", ["direct", "nodes"])
def test_sigterm_keeps_a_checkpoint_and_the_run_goes_on(whole: Path, start: Callable, mode: str) -> None:
    """The checkpoint is of the last tick recorded, and named; then the other way of running goes on."""
    run = start("first", mode)
    wait_for_checkpoint(run)
    run.process.send_signal(signal.SIGTERM)
    status, _, err = run.finish()
    assert status == 143, err
    kept = summary(run.out)["checkpoint"]
    assert f"checkpoint: {kept['path']}" in err.strip().splitlines()[-1]
    communication_step_ns = load_scene(run.out / "scene.yaml").timing.communication_step_ns
    assert messages(run.out / "bag")[-1][1] == (kept["tick"] + 1) * communication_step_ns
    other = {"direct": "nodes", "nodes": "composed"}[mode]
    second = start("second", other, "--resume", str(run.out))
    status, _, err = second.finish()
    assert status == 0, err
    assert summary(second.out)["resumed_from"]["tick"] == kept["tick"]
    assert_same(whole, run.out, second.out)


@pytest.mark.full
@pytest.mark.parametrize("victim", ["recorder", "subsoil"])
def test_a_run_that_was_killed_goes_on(whole: Path, start: Callable, victim: str, tmp_path: Path) -> None:
    """kill -9 of a node or of `subsoil run`: the newest checkpoint is whole, and the record reaches it."""
    run = start("first", "nodes")
    wait_for_checkpoint(run)
    pids = run.node_pids()
    os.kill(pids.get(victim, run.process.pid), signal.SIGKILL)
    status, _, err = run.finish()
    if victim != "subsoil":
        assert status == 3, err
        assert "checkpoint: " in err.strip().splitlines()[-1]
    wait_until_gone(pids)
    second = start("second", "direct", "--resume", str(run.out), "--threads", "2")
    status, _, err = second.finish()
    assert status == 0, err
    assert_same(whole, run.out, second.out)


@pytest.mark.full
def test_twice_interrupted_while_the_machine_is_busy(whole: Path, start: Callable) -> None:
    """kill -9 of a direct run, SIGTERM of the next, every core taken by others: three folders, one run."""
    burn = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
    try:
        first = start("first", "direct")
        wait_for_checkpoint(first)
        first.process.kill()
        first.finish()
        second = start("second", "direct", "--resume", str(first.out))
        wait_for_checkpoint(second)
        second.process.send_signal(signal.SIGTERM)
        assert second.finish()[0] == 143
        third = start("third", "nodes", "--resume", str(second.out))
        status, _, err = third.finish()
        assert status == 0, err
    finally:
        for process in burn:
            process.kill()
            process.wait()
    assert (third.out / "series.csv").read_bytes() == (whole / "series.csv").read_bytes()
    assert summary(third.out)["state_sha256"] == summary(whole)["state_sha256"]
    times_ns = [cloud.end_time_ns for cloud in open_record(third.out / "bag").clouds(1)]
    assert times_ns == [cloud.end_time_ns for cloud in open_record(whole / "bag").clouds(1)]
    before = summary(third.out)
    assert main(["report", str(third.out)]) == 0
    assert summary(third.out) == before


def test_from_every_checkpoint_and_without_a_recorder(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The state is the same where nothing is recorded, with other clouds and series, and from whichever
    checkpoint a run goes on."""
    monkeypatch.setattr(checkpoint, "KEPT", 100)
    end = summary(whole)["state_sha256"]

    def run(name: str, resumed: Path | None, *overrides: str) -> None:
        resolved = load_scene(whole / "scene.yaml", overrides)
        kept = read_checkpoint(resumed) if resumed is not None else None
        simulate(RunSettings(resolved, name, checkpoints=tmp_path / name, resumed=kept))
        assert end_digests(tmp_path / name) == end

    run("bare", None, "record.cloud_hz=0", "record.checkpoint_s=0", "record.series_ticks=7")
    run("whole", None)
    kept = sorted(path.parent for path in (tmp_path / "whole").glob("*/manifest.json"))
    assert len(kept) == 12
    for folder in kept[5::3]:
        run(folder.name, folder)
        for part in ("soil", "mechanism"):  # the later checkpoints are the same too
            last = tmp_path / folder.name / kept[-1].name
            if folder != kept[-1]:
                assert (last / f"{part}.npz").read_bytes() == (kept[-1] / f"{part}.npz").read_bytes()


def test_tools_on_paths_go_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A scene without mechanism: the soil's process keeps the paths too."""
    scene = Path(__file__).parents[2] / "config/scenes/tine.yaml"
    values = {"bin.length_m": 0.3, "bin.width_m": 0.1, "bin.depth_m": 0.24}
    sets = [f"--set=soil.{key}={value}" for key, value in values.items()]
    sets += ["--set=duration_s=0.008", "--set=record.checkpoint_s=0.003"]
    first, second = tmp_path / "first", tmp_path / "second"
    assert main(["run", str(scene), "--out", str(first), "--mode", "composed", *sets]) == 0
    again = [*sets, "--resume", str(first)]
    assert main(["run", str(scene), "--out", str(second), "--mode", "direct", *again]) == 0
    assert (second / "series.csv").read_bytes() == (first / "series.csv").read_bytes()
    assert summary(second)["state_sha256"] == summary(first)["state_sha256"]
    assert sorted(summary(first)["state_sha256"]) == ["coupling", "paths", "soil"]


@pytest.mark.full
@pytest.mark.parametrize("tick", [9, 129, 139])
def test_a_controlled_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tick: int
) -> None:
    """From before the first command, between two, and from where one is due at once."""
    monkeypatch.setattr(checkpoint, "KEPT", 100)
    scene = str(SCENE.parent / "mechanism_only.yaml")
    sets = [word for change in (*CHANGES, "record.checkpoint_s=0.005") for word in ("--set", change)]
    first, second = tmp_path / "first", tmp_path / "second"
    assert main(["run", scene, "--out", str(first), "--mode", "direct", *sets]) == 0
    for path in first.glob("checkpoints/tick_*"):
        if path.name > f"tick_{tick:012d}":
            shutil.rmtree(path)
    mode = "direct" if tick == 9 else "composed"
    assert main(["run", scene, "--out", str(second), "--mode", mode, *sets, "--resume", str(first)]) == 0
    assert summary(second)["resumed_from"]["tick"] == tick
    assert (tick + 1) % CONTROL["interval_ticks"] == {9: 10, 129: 10, 139: 0}[tick]
    assert (second / "series.csv").read_bytes() == (first / "series.csv").read_bytes()
    assert joined(first, second) == without_wall_time(first)
    assert summary(second)["state_sha256"] == summary(first)["state_sha256"]


@pytest.fixture
def interrupted(whole: Path, tmp_path: Path) -> Path:
    """A run folder with two checkpoints, as an interruption leaves it."""
    out = tmp_path / "interrupted"
    shutil.copytree(whole, out)
    return out


def resume(out: Path, to: Path, *more: str) -> int:
    """Goes on with it."""
    return main(run_arguments(to, "direct", DURATION_S, *EVERY, "--resume", str(out), *more))


def spoil_bytes(folder: Path) -> None:
    """One bit of the soil turns round."""
    path = folder / "soil.npz"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def truncate(folder: Path) -> None:
    """The end of the mechanism is not there."""
    path = folder / "mechanism.npz"
    path.write_bytes(path.read_bytes()[:-100])


def lose(folder: Path) -> None:
    """A part is gone."""
    (folder / "soil.npz").unlink()


def spoil_manifest(folder: Path) -> None:
    """A digit of a force changes."""
    path = folder / "manifest.json"
    path.write_text(path.read_text().replace('"tick": ', '"tick": 1', 1))


def cut_manifest(folder: Path) -> None:
    """Half of the manifest is not there."""
    path = folder / "manifest.json"
    path.write_text(path.read_text()[:500])


def make_foreign(key: str, value: object) -> Callable[[Path], None]:
    """A manifest, whole, that says something else."""

    def change(folder: Path) -> None:
        path = folder / "manifest.json"
        document = json.loads(path.read_text())
        document.pop("sha256")
        document[key] = value
        path.write_text(json.dumps(document | {"sha256": checkpoint.document_sha256(document)}))

    return change


DAMAGES = {
    "bytes": (spoil_bytes, "damaged (checksum)"),
    "truncated": (truncate, "damaged"),
    "lost": (lose, "No such file"),
    "manifest": (spoil_manifest, "checksum of manifest.json"),
    "cut manifest": (cut_manifest, "manifest.json cannot be read"),
    "format": (make_foreign("format", 0), "of format 0"),
    "version": (make_foreign("package_version", "0.0.1"), "of subsoil_ros 0.0.1"),
    "laws": (make_foreign("laws", {"own": "f" * 64}), "of other contact laws"),
    "scene": (make_foreign("scene_hash", "f" * 64), "of another scene"),
}


@pytest.mark.parametrize("damage", list(DAMAGES))
def test_a_checkpoint_that_cannot_be_used_is_named(
    whole: Path, interrupted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    """With the one before the run goes on all the same, and without it exit 2 with one message."""
    spoil, said = DAMAGES[damage]
    older, newer = sorted(path.parent for path in interrupted.glob("checkpoints/*/manifest.json"))
    spoil(newer)
    assert resume(interrupted, tmp_path / "second") == 0
    warning = next(line for line in capsys.readouterr().err.splitlines() if line.startswith("warning:"))
    assert said in warning
    assert newer.name in warning
    assert warning.endswith(f"using {older.name}")
    assert summary(tmp_path / "second")["state_sha256"] == summary(whole)["state_sha256"]
    spoil(older)
    assert resume(interrupted, tmp_path / "third") == 2
    err = capsys.readouterr().err
    assert len(err.strip().splitlines()) == 1
    assert said in err
    assert not (tmp_path / "third").exists()


def test_a_record_that_ends_before_the_checkpoint_is_not_gone_on_from(
    interrupted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bag that lost its end after the checkpoint was written: no gap in the joined record."""
    (bag,) = (interrupted / "bag").glob("*.mcap")
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size // 2])
    assert resume(interrupted, tmp_path / "second") == 2
    assert "the record beside it ends before" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "said"), [("nothing", "no such folder"), ("empty", "no bag there"), ("bare", "no checkpoint")]
)
def test_a_folder_without_checkpoint_is_refused(
    interrupted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, said: str
) -> None:
    """Exit 2, one message, nothing written."""
    (tmp_path / "empty").mkdir()
    shutil.copytree(interrupted / "bag", tmp_path / "bare" / "bag")
    assert resume(tmp_path / name, tmp_path / "second") == 2
    err = capsys.readouterr().err
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "second").exists()


def test_another_scene_is_refused(
    interrupted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One --set more or less is another scene."""
    assert resume(interrupted, tmp_path / "second", "--set", "gravity_m_per_s2=9.8") == 2
    assert "checkpoint of another scene" in capsys.readouterr().err
