"""Memory of a run is bounded by the chunks of its bag, not by its length."""

import subprocess
import sys
from pathlib import Path

import pytest

CHUNK_INDEX_BYTES = (
    1500  # of a chunk in the bag's index, as Python objects: 8 topics, 70 bytes each, and more
)
SLACK_BYTES = 1_000_000  # two chunks, raw and compressed, and what the allocator keeps

PROGRAM = """
import sys
from pathlib import Path
import psutil
from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.observer import RunWatch
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.loading.loader import load_scene

def resident():
    return psutil.Process().memory_info().rss

def look(tick):
    if tick + 1 in (ticks // 4, ticks):
        print(resident(), (out / "bag_0.mcap").stat().st_size, flush=True)

scene, out, ticks = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
resolved = load_scene(scene, [f"duration_s={ticks * 1e-4}", "coupling.communication_step_ns=100000"])
simulate(RunSettings(resolved, bag=out), observer=RunWatch(look))
"""


@pytest.mark.full
def test_a_long_run_takes_no_more_memory_than_a_short_one(tmp_path: Path) -> None:
    """12,000 ticks: 200 bytes left behind in each would be 1.8 MB in the last three quarters."""
    scene = Path(__file__).parents[2] / "config/scenes/mechanism_only.yaml"
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(scene), str(tmp_path / "bag"), "12000"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    (before, first), (after, last) = (map(int, line.split()) for line in done.stdout.splitlines())
    chunks = (last - first) / 10_000  # at least 10 kB compressed
    assert last > 2 * first
    assert after - before < SLACK_BYTES + CHUNK_INDEX_BYTES * chunks
