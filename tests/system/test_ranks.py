"""A soil on two ranks of MPI, as `subsoil run --ranks` starts it: the same forces, and faults."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import psutil
import pytest
from numpy.testing import assert_allclose

from subsoil_ros.cli.main import main
from tests.soils import DRY
from tests.system.test_faults import assert_readable
from validation.laboratory import box_mesh

Captured = pytest.CaptureFixture[str]
LIMIT_S = 120.0
ROW = DRY | {"static_friction": 0.4}


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A plate in the middle of a bin, which two ranks halve: it touches particles of both."""
    path, mesh = tmp_path / "bin.yaml", box_mesh(tmp_path, 0.03, 0.06, 0.06)
    path.write_text(f"""
name: bin
duration_s: 0.1
soil:
  engine: lammps
  max_lost_particles: 50
  bin: {{length_m: 0.24, width_m: 0.16, depth_m: 0.08}}
  particles: {{radius_m: 0.01, density_kg_per_m3: 1800.0}}
  bed: {{kind: grid, spacing_m: 0.02}}
  law: {{kind: linear, particle: {ROW}, boundary: {ROW}}}
tools:
  plate:
    path: {{start_x_m: 0.1195, speed_x_m_per_s: {{kind: constant, value: 0.3}}}}
    groups: {{face: {{mesh: {mesh}}}}}
coupling: {{communication_step_ns: 500000}}
record: {{series_ticks: 1, checkpoint_s: 0.04}}
""")
    return path


@pytest.fixture
def started(scene: Path, tmp_path: Path) -> Iterator[subprocess.Popen]:
    """A run on two ranks that is about to write its second checkpoint, so that the first is whole."""
    command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(scene), "--ranks", "2", "--out"]
    process = subprocess.Popen(
        [*command, str(tmp_path / "two")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    end, seen = time.monotonic() + LIMIT_S, set[Path]()
    while len(seen) < 2 and process.poll() is None:
        assert time.monotonic() < end
        seen.update(tmp_path.glob("two/checkpoints/tick_*"))
        time.sleep(0.02)
    yield process
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        process.wait(LIMIT_S)


def test_a_killed_rank_ends_the_run_and_another_number_of_ranks_goes_on(
    started: subprocess.Popen, scene: Path, tmp_path: Path
) -> None:
    """Exit 3, one message that names the checkpoint, no process left; drafts of one rank and of two agree."""
    ranks = [
        process
        for process in psutil.Process(started.pid).children(recursive=True)
        if process.cmdline()[1:3] == ["-m", "subsoil_ros.dem.lammps.ranks"]
    ]
    assert len(ranks) == 1
    left = psutil.Process(started.pid).children(recursive=True)
    os.kill(ranks[0].pid, signal.SIGKILL)
    _, errors = started.communicate(timeout=LIMIT_S)
    assert started.returncode == 3, errors
    last = errors.strip().splitlines()[-1]
    assert last.startswith("subsoil run: soil: a rank of MPI ended before the run did; its log is ")
    assert "; checkpoint: " in last
    assert not [process for process in left if process.is_running()]
    assert_readable(tmp_path / "two")
    resumed = ["--resume", str(tmp_path / "two"), "--mode", "direct", "--out", str(tmp_path / "one")]
    assert main(["run", str(scene), *resumed]) == 0
    assert main(["run", str(scene), "--mode", "direct", "--out", str(tmp_path / "whole")]) == 0
    one, whole = (pd.read_csv(tmp_path / name / "series.csv") for name in ("one", "whole"))
    assert len(one) == len(whole) == 201
    same = slice(0, 80)  # before the checkpoint: on two ranks, from then on on one
    assert_allclose(one.draft_newton[same], whole.draft_newton[same], atol=1e-6 * whole.draft_newton.max())
    assert whole.draft_newton[same].max() > 1.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ranks", "2", "--mode", "direct"], "--ranks: given 2, but --mode direct has one process"),
        (["--ranks", "2", "--set", "soil.engine=own"], "but only soil.engine: 'lammps' has ranks"),
    ],
)
def test_ranks_that_cannot_be_are_refused(
    scene: Path, tmp_path: Path, capsys: Captured, arguments: list[str], words: str
) -> None:
    """Exit 2, nothing written."""
    out = tmp_path / "out"
    assert main(["run", str(scene), "--out", str(out), *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_without_mpiexec_the_way_to_it_is_told(
    scene: Path, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither beside Python nor on the path."""
    monkeypatch.setattr("subsoil_ros.ros.process.mpi.shutil.which", lambda *_, **__: None)
    assert main(["run", str(scene), "--ranks", "2", "--out", str(tmp_path / "out")]) == 2
    assert "needs mpiexec" in capsys.readouterr().err
