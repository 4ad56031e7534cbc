"""Shared memory without room: a run takes UDP, says so in one line, and records the same."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from subsoil_ros.cli.main import main
from subsoil_ros.ros.transport import shared_memory
from subsoil_ros.ros.transport.ros_domain import run_domain
from subsoil_ros.ros.transport.shared_memory import (
    LOADED_BYTES,
    PROCESS_BYTES,
    TRANSPORTS,
    avoid_full_memory,
)
from tests.system.conftest import LIMIT_S, SCENE

PROGRAMS = Path(sys.prefix) / "lib" / "subsoil_ros"
"""Where `ros2 run` and launch_ros find the nodes."""

WEDGE = Path(__file__).parents[2] / "config/scenes/three_shanks_wedge.yaml"


@pytest.fixture(autouse=True)
def _no_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """The environment names no transports, and what a test sets goes with it."""
    monkeypatch.setenv(TRANSPORTS, "")


def with_room(monkeypatch: pytest.MonkeyPatch, free: int) -> None:
    """A stand-in for a file system with so much room."""
    monkeypatch.setattr(shared_memory, "free_bytes", lambda: free)


def test_room_is_enough_for_all_processes_or_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bound is that of the processes asked for; below it UDP is set, and said with both numbers."""
    with_room(monkeypatch, 4 * PROCESS_BYTES)
    assert avoid_full_memory(4) == ""
    assert os.environ[TRANSPORTS] == ""
    with_room(monkeypatch, 4 * PROCESS_BYTES - 1)
    assert "has 4.0 MiB free, shared memory for 4 processes takes 4 MiB" in avoid_full_memory(4)
    assert os.environ[TRANSPORTS] == "UDPv4"


def test_what_the_user_chose_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Transports named in the environment are left alone, full or not."""
    with_room(monkeypatch, LOADED_BYTES)
    monkeypatch.setenv(TRANSPORTS, "SHM")
    assert avoid_full_memory(4) == ""
    assert os.environ[TRANSPORTS] == "SHM"


def test_no_room_at_all_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where a node could not even load ROS: status 2, one message, nothing left."""
    with_room(monkeypatch, LOADED_BYTES - 1)
    for mode in ("nodes", "composed"):
        assert main(["run", str(WEDGE), "--out", str(tmp_path / "out"), "--mode", mode]) == 2
        said = capsys.readouterr().err.strip().splitlines()[-1]  # after the line of progress
        assert f"is full: {LOADED_BYTES - 1} bytes are free" in said
        assert "make room there, or run without ROS: subsoil run --mode direct" in said
        assert not (tmp_path / "out").exists()


@pytest.mark.full
def test_a_run_without_room_records_the_same(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four processes over UDP: status 0, one line, the series of the run without ROS."""
    with_room(monkeypatch, 100_000)
    short = ["--set", "duration_s=0.05", "--set", "record.series_ticks=5"]
    assert main(["run", str(WEDGE), "--out", str(tmp_path / "nodes"), "--mode", "nodes", *short]) == 0
    said = capsys.readouterr().err
    assert said.count("messages go by UDP") == 1
    assert main(["run", str(WEDGE), "--out", str(tmp_path / "direct"), "--mode", "direct", *short]) == 0
    assert (tmp_path / "nodes/series.csv").read_bytes() == (tmp_path / "direct/series.csv").read_bytes()


@pytest.fixture
def in_small_memory() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs a command where /dev/shm has so many KiB: a file system of its own, which needs no root."""

    def run(kib: int, *command: str | Path) -> subprocess.CompletedProcess[str]:
        mounted = f'mount -t tmpfs -o size={kib}k none /dev/shm && exec "$@"'
        words = ["unshare", "--map-root-user", "--mount", "sh", "-c", mounted, "sh", *command]
        return subprocess.run(words, capture_output=True, text=True, timeout=LIMIT_S, check=False)

    try:
        tried = run(4, "true")
    except FileNotFoundError:
        pytest.skip("there is no program 'unshare' here")
    if tried.returncode:
        pytest.skip(f"no file system can be mounted here: {tried.stderr.strip()}")
    return run


@pytest.mark.parametrize("name", ["soil", "mechanism", "coupler", "recorder", "controller"])
def test_a_node_is_refused_where_it_could_not_load_ros(in_small_memory: Callable, name: str) -> None:
    """One page is free, and the tracing library needs two: status 2 and one message in place of SIGBUS."""
    done = in_small_memory(4, PROGRAMS / f"{name}_node", "--help")
    assert done.returncode == 2, done
    assert done.stderr.startswith(f"{name}: /dev/shm is full: 4096 bytes are free")
    assert done.stderr.count("\n") == 1


@pytest.mark.full
def test_nodes_started_by_hand_take_udp(in_small_memory: Callable, tmp_path: Path) -> None:
    """Where pages for three are free: each says so in one line, and the run reaches its end."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(f"base: {SCENE.with_name('mechanism_only.yaml')}\nduration_s: 0.05\n")
    script = (
        'for name in mechanism recorder coupler; do "$0/${name}_node" --ros-args -p scene:="$1" '
        '-p bag:="$2" & nodes="$nodes $!"; done; for node in $nodes; do wait "$node" || exit; done'
    )
    with run_domain() as domain:
        words = ("env", f"ROS_DOMAIN_ID={domain}", "sh", "-c", script, PROGRAMS, scene, tmp_path / "bag")
        done = in_small_memory(64, *words)  # each maps two pages of 4 KiB
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("messages go by UDP") == 3
