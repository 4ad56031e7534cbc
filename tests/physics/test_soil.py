"""The soil engine gives the same bits for any number of threads and in every process."""

import json
import os
import subprocess
import sys
from pathlib import Path

from tests.physics.conftest import SoilMaker, one_tool
from tests.soils import WET


def digests(scene: Path, *threads: int) -> dict[str, dict]:
    """What soil_digest prints in a fresh process that may use four threads."""
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("soil_digest.py")), str(scene), *map(str, threads)],
        env=os.environ | {"NUMBA_NUM_THREADS": "4"},
        check=True,
        capture_output=True,
        text=True,
    )
    return json.loads(done.stdout)


def test_4000_steps_are_the_same_bits_for_one_to_four_threads_and_in_another_process(tmp_path):
    """A bar is swept through a wet bed, so that pairs part, meet and change their places in the lists."""
    maker = SoilMaker(tmp_path)
    maker.scene(
        soil={
            "bin": {"length_m": 0.3, "width_m": 0.1, "depth_m": 0.1},
            "particles": {"radius_m": 0.01, "density_kg_per_m3": 1800.0},
            "bed": {"kind": "grid", "spacing_m": 0.018, "jitter_m": 0.0004},
            "law": WET,
            "time_step_s": 4e-5,
        },
        tools=one_tool(maker.box(0.03, 0.04, 0.08, subdivide=1)),
    )
    (scene,) = tmp_path.glob("*.yaml")
    results = digests(scene, 1, 2, 3, 4)
    first = results["1"]
    assert first["rebuilds"] > 10
    assert first["moved_m"] > 0.02
    assert all(other == first for other in results.values())
    assert digests(scene, 2)["2"] == first
