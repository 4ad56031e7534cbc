"""What takes seconds says so on a terminal, and prints nothing elsewhere."""

import os
import pty
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.soil_cases import DENSE, GRID, linear_case
from subsoil_ros.api.prepare_bed import prepare_bed_first
from subsoil_ros.cli.main import main
from subsoil_ros.cli.progress import bed_progress

ROOT = Path(__file__).parents[2]


def on_a_terminal(*words: str) -> str:
    """Standard error of a command that ends well, as a terminal gets it."""
    reader, terminal = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "200"}
    with subprocess.Popen(
        [sys.executable, "-m", "subsoil_ros.cli.main", *words],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=terminal,
    ) as process:
        os.close(terminal)
        said = b""
        while True:
            try:
                part = os.read(reader, 65536)
            except OSError:  # Linux' word for: the other side is closed
                break
            if not part:
                break
            said += part
    os.close(reader)
    assert process.returncode == 0, said
    return said.decode(errors="replace")


def assert_shown(words: tuple[str, ...], *steps: str) -> None:
    """A command shows these, one after the other."""
    said, at = on_a_terminal(*words), 0
    for step in steps:
        at = said.find(step, at)
        assert at >= 0, (words, step, said)


@pytest.mark.full
def test_bars_of_a_run_and_what_follows(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Each step of run, report and compare in its turn; nothing of it in a pipe."""
    assert main(["new", str(tmp_path / "scene"), "--template", "wedge"]) == 0
    out, scene = tmp_path / "out", tmp_path / "scene/scene.yaml"
    run = ["run", str(scene), "--mode", "direct", "--set", "duration_s=0.05"]
    assert_shown((*run, "--out", str(out)), "of 0.050 s", "reading the bag", "reading the clouds")
    again = shutil.copytree(out, tmp_path / "again")
    expected = {
        ("report", str(out), "--html"): ("reading the clouds", "drawing the figures", "writing the page"),
        ("compare", str(out), str(again), "--out", str(tmp_path / "both")): (
            "reading the series",
            "drawing the curves",
        ),
    }
    for words, steps in expected.items():
        assert_shown(words, *steps)
    capfd.readouterr()
    assert main(["report", str(out), "--html"]) == 0
    assert capfd.readouterr().err == ""


def test_a_log_gets_two_lines_about_a_bed(tmp_path, monkeypatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A line before, a line after; none when the bed is in the cache, and none for a grid."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("subsoil_ros.dem.packing.dense_random.PILOT_DIAMETERS", 5.0)  # quick
    case = linear_case(DENSE, (0.06, 0.06, 0.06), 1, "small")
    prepare_bed_first(case.resolved, 1, bed_progress)
    before, after = capsys.readouterr().err.splitlines()
    assert before.startswith("preparing a dense random bed of about ")
    assert after.startswith("prepared a dense random bed of about ")
    prepare_bed_first(case.resolved, 1, bed_progress)
    prepare_bed_first(linear_case(GRID, (0.1, 0.1, 0.1), 1, "grid").resolved, 1, bed_progress)
    assert capsys.readouterr().err == ""
