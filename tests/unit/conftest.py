"""What several unit tests share."""

import platform
import subprocess
from pathlib import Path

import pytest

from tests.unit.recording.recording_samples import write_bag

platform.platform()  # the standard library asks `uname` once, and then knows


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A finished bag of a made-up run."""
    return write_bag(tmp_path / "bag")


@pytest.fixture(autouse=True)
def _no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A test that starts a process belongs into tests/system."""

    def refuse(_: object, command: object, *__: object) -> None:
        raise AssertionError(f"tests/unit starts no process: {command}")

    monkeypatch.setattr(subprocess.Popen, "_execute_child", refuse)
