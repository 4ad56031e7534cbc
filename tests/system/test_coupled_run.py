"""A machine that works a whole bin and meets what a short run does not: deep overlaps, loose particles."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.conftest import LIMIT_S

SCENE = Path(__file__).parents[2] / "config" / "scenes" / "subsoiler_1s300_quick.yaml"


@pytest.mark.full
def test_the_machine_comes_through_its_bin(tmp_path):
    """The quick scene with particles of twice the radius and a law scaled to them, in a bin of 0.6 m.

    No monitor stops it, no particle is lost, the soil resists, and the exchange invents no energy.
    """
    larger = (
        "soil.particles.radius_m=0.02",
        "soil.particles.reference_radius_m=0.01",
        "soil.bed.spacing_m=rest",
    )
    changes = (*larger, "soil.bin.length_m=0.6", "duration_s=1.2")
    settings = [word for change in changes for word in ("--set", change)]
    command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(SCENE), "--mode", "direct"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "run"), *settings],
        env=dict(os.environ),
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["series"]["draft_newton"]["mean"] > 0.0
    assert summary["series"]["coupling.residual_ratio"]["max"] < 0.02
    assert summary["particles"]["lost_count"] == 0
