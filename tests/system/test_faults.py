"""Runs as separate processes that are interrupted or lose a part: all end, the bag can be read."""

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from subsoil_ros.cli.main import main
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.recording.recovery import recover
from tests.system.conftest import SCENE, is_alive, lockstep_ticks, run_arguments, wait_until_gone
from validation.laboratory import box_mesh


def assert_readable(out: Path, cut: bool = False) -> int:
    """The bag has every tick up to its end once, in order. Returns the number of ticks.

    `cut`: its writer was killed, so the last chunk may end within a tick.
    """
    communication_step_ns = load_scene(out / "scene.yaml").timing.communication_step_ns
    ticks = lockstep_ticks(out / "bag", communication_step_ns)
    lengths = [len(found) for found in ticks.values()]
    count = min(lengths)
    assert count > 10
    assert max(lengths) - count <= (1 if cut else 0)
    assert {name: found[:count] for name, found in ticks.items()} == {
        name: list(range(count)) for name in ticks
    }
    return count


@pytest.mark.parametrize(
    "victim",
    ["soil", *(pytest.param(name, marks=pytest.mark.full) for name in ("recorder", "coupler", "mechanism"))],
)
def test_a_node_that_dies_ends_the_run(start_run: Callable, victim: str) -> None:
    """kill -9 of a node: exit 3, one message that names it, no process left, bag readable."""
    run, pids = start_run()
    assert sorted(pids) == ["coupler", "mechanism", "recorder", "soil"]
    os.kill(pids[victim], signal.SIGKILL)
    status, _, err = run.finish()
    assert status == 3, err
    last = err.strip().splitlines()[-1]
    assert last.startswith(f"subsoil run: {victim} node (process {pids[victim]}) was ended by SIGKILL")
    assert not any(is_alive(pid) for pid in pids.values())
    assert_readable(run.out, cut=victim == "recorder")
    assert victim in json.loads((run.out / "summary.json").read_text())["run"]["failure"]


@pytest.mark.full
def test_a_node_that_stands_still_ends_the_run(start_run: Callable) -> None:
    """SIGSTOP of a node: its silence is noticed and named, and it is ended too."""
    run, pids = start_run()
    os.kill(pids["soil"], signal.SIGSTOP)
    status, _, err = run.finish()
    assert status == 3, err
    assert "soil has not been heard of" in err.strip().splitlines()[-1]
    assert not any(is_alive(pid) for pid in pids.values())
    assert_readable(run.out)


@pytest.mark.full
@pytest.mark.parametrize("mode", ["nodes", "direct"])
def test_a_closed_terminal_fails_the_run_in_order(start_run: Callable, mode: str) -> None:
    """SIGHUP: the end was not asked for: exit 3 with the cause; the bag is finished, no process is left."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup the run would rightly go on
    run, pids = start_run(mode)
    signal.signal(signal.SIGHUP, before)
    run.process.send_signal(signal.SIGHUP)
    status, _, err = run.finish()
    assert status == 3, err
    assert "the terminal was closed" in err.strip().splitlines()[-1]
    assert not any(is_alive(pid) for pid in pids.values())
    assert not list(run.out.glob("bag/*.damaged"))
    assert_readable(run.out)


@pytest.mark.parametrize(
    ("number", "expected", "mode"),
    [
        (signal.SIGINT, 130, "nodes"), (signal.SIGINT, 130, "direct"),
        pytest.param(signal.SIGINT, 130, "composed", marks=pytest.mark.full),
        pytest.param(signal.SIGTERM, 143, "nodes", marks=pytest.mark.full),
    ],
)  # fmt: skip
def test_an_interrupted_run_leaves_a_finished_bag(
    start_run: Callable, mode: str, number: signal.Signals, expected: int
) -> None:
    """Ctrl-C and SIGTERM: the shell's exit status, bag closed and readable, no process left."""
    run, pids = start_run(mode)
    run.process.send_signal(number)
    status, _, err = run.finish()
    assert status == expected, err
    assert (
        err.strip()
        .splitlines()[-1]
        .startswith(f"subsoil run: ended by {number.name}; checkpoint: {run.out}/checkpoints/tick_")
    )
    assert not any(is_alive(pid) for pid in pids.values())
    assert not list(run.out.glob("bag/*.damaged"))  # it did not have to be mended
    assert_readable(run.out)


def test_nodes_end_when_their_supervisor_is_killed(start_run: Callable) -> None:
    """kill -9 of `subsoil run` itself: the nodes notice, end, and the recorder closes its bag."""
    run, pids = start_run()
    run.process.kill()
    wait_until_gone(pids)
    assert_readable(run.out)


def test_an_existing_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--out that exists: exit 2, nothing is written into it."""
    assert main(run_arguments(tmp_path, "nodes", 0.01)) == 2
    assert "exists already" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_created_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--out below a file: exit 2 with the system's reason."""
    (tmp_path / "file").write_text("")
    assert main(run_arguments(tmp_path / "file/out", "nodes", 0.01)) == 2
    assert "cannot be created (Not a directory)" in capsys.readouterr().err


def test_a_bad_scene_leaves_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A scene that is refused: exit 2, the output folder is not created."""
    out = tmp_path / "out"
    assert main([*run_arguments(out, "nodes", 0.01), "--set", "soil.particles.radius_m=-1"]) == 2
    assert "radius_m" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("mode", ["nodes", "composed", "direct"])
def test_bad_input_that_only_the_start_shows_leaves_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], mode: str
) -> None:
    """A tool larger than the bed, found by the soil engine at its start: exit 2, one message, no folder."""
    cube = box_mesh(tmp_path, 2.0, 2.0, 2.0)
    out, tine = tmp_path / "out", SCENE.with_name("tine.yaml")
    larger = ["--set", f"tools.tine.groups.share.mesh={cube}"]
    assert main(run_arguments(out, mode, 0.01, *larger, scene=tine)) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "tools: they overlap every particle of the bed; check their scale and position" in said
    assert not out.exists()


def test_a_full_disk_ends_the_run(start_run: Callable) -> None:
    """The bag may not grow beyond 200 kB: exit 3, the disk's words, what is on the disk can be mended."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limit[1]))
    try:
        run, pids = start_run()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    status, _, err = run.finish()
    assert status == 3, err
    last = err.strip().splitlines()[-1]
    assert "recorder: " in last
    assert "cannot be written (File too large)" in last
    assert not any(is_alive(pid) for pid in pids.values())
    copy = run.out.with_name("copy")
    shutil.copytree(run.out / "bag", copy / "bag")
    (copy / "scene.yaml").write_bytes((run.out / "scene.yaml").read_bytes())
    recover(copy / "bag")
    assert_readable(copy)


@pytest.mark.full
def test_a_second_soil_ends_the_run(start_run: Callable) -> None:
    """Another soil node of the same run: named, both end, exit 3."""
    run, pids = start_run()
    coupler = psutil.Process(pids["coupler"])
    run_id = re.search(r'run_id:="(\w+)"', " ".join(coupler.cmdline())).group(1)
    parameters = ("-p", f"scene:={run.out / 'scene.yaml'}", "-p", f"run_id:='{run_id}'")
    second = subprocess.Popen(
        [sys.executable, "-m", "subsoil_ros.ros.nodes.soil_node", "--ros-args", *parameters],
        env=coupler.environ(),
        stderr=subprocess.DEVNULL,
    )
    try:
        status, _, err = run.finish()
        assert second.wait(30.0) == 3
    finally:
        second.kill()
        second.wait()
    assert status == 3, err
    last = err.strip().splitlines()[-1]
    soil = r"node '/soil(_process)?' on this machine"
    assert re.search(rf": {soil} and {soil} publishes on it; in a run only ", last)
    assert not any(is_alive(pid) for pid in pids.values())
    assert_readable(run.out)
