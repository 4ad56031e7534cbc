"""Shared memory without room: a run takes UDP, says so in one line, and records the same."""

import os
from pathlib import Path

import pytest

from subsoil_ros.cli.main import main
from subsoil_ros.ros.transport import shared_memory
from subsoil_ros.ros.transport.shared_memory import (
    LOADED_BYTES,
    PROCESS_BYTES,
    TRANSPORTS,
    avoid_full_memory,
)

pytestmark = pytest.mark.ros

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
