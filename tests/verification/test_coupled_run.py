"""A machine that works a whole bin: what a short run never meets, deep overlaps and lost particles among it."""

import json
import os
import subprocess
import sys
from pathlib import Path

from ..ros.conftest import LIMIT_S

SCENE = Path(__file__).parents[2] / "config" / "scenes" / "subsoiler_1s300_quick.yaml"


def test_the_machine_comes_through_its_bin(tmp_path):
    """The quick scene with particles of twice the radius and a law scaled to them, to its end at 2 s: no monitor
    stops it, no particle is lost, the soil resists, and the exchange invents no energy."""
    changes = ("radius_m=0.02", "law_radius_m=0.01")
    settings = [*(f"soil.particles.{change}" for change in changes), "soil.bed.spacing_m=rest"]
    done = subprocess.run(
        [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(SCENE), "--mode", "direct"]
        + ["--out", str(tmp_path / "run"), *(word for change in settings for word in ("--set", change))],
        env=dict(os.environ),
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["draft_newton_mean"] > 0.0
    assert summary["coupling.residual_ratio_max"] < 0.02
    assert summary["soil.lost_particle_count_max"] == 0
