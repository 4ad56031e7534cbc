"""A scene on the wedge model run in every way, in fresh processes: the same bits."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.conftest import lockstep_ticks

SCENE = Path(__file__).parents[2] / "config" / "scenes" / "subsoiler_1s300_wedge.yaml"
DURATION_S = 0.5
"""The wheels come down in 0.3 s, then the machine is pulled; AT_WORK: share in the soil at once."""
AT_WORK = "mechanism.initial.translate_x_m=0.4"

pytestmark = pytest.mark.full  # make test has test_modes.py for the machine in particles


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Result folders, by mode."""
    folders = {}
    for mode in ("direct", "composed", "nodes"):
        out = tmp_path_factory.mktemp(mode) / "out"
        command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(SCENE), "--mode", mode]
        command += ["--out", str(out), "--set", f"duration_s={DURATION_S}", "--set", AT_WORK]
        result = subprocess.run(command, capture_output=True, text=True, env=dict(os.environ), check=False)
        assert result.returncode == 0, result.stderr
        folders[mode] = out
    return folders


@pytest.mark.parametrize("mode", ["composed", "nodes"])
def test_series_are_equal_byte_for_byte(results: dict[str, Path], mode: str) -> None:
    """series.csv does not depend on the way of running."""
    assert (results[mode] / "series.csv").read_bytes() == (results["direct"] / "series.csv").read_bytes()


def test_the_share_is_at_work(results: dict[str, Path]) -> None:
    """The comparison is not one of zeros, and there is no cloud in the bag."""
    head, *_, last = (results["direct"] / "series.csv").read_text().splitlines()
    row = dict(zip(head.split(","), last.split(","), strict=True))
    assert float(row["tool.shank.share.force_x_newton"]) < -100.0
    assert float(row["tool.wheel_left.force_z_newton"]) > 0.0
    ticks = lockstep_ticks(results["nodes"] / "bag", 1_000_000)
    assert all(found == list(range(500)) for found in ticks.values())
