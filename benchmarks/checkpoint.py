"""Size and time of a checkpoint of the paper's bed of 130,000 particles, on the disk that `--folder` names.

`python benchmarks/checkpoint.py [--folder DIR] [--repeats 5] [--json]`. Two rows: the grid at its start (3
listed pairs per particle), and with a skin so wide that more pairs are listed (9) than in a dense random
bed (6.5). The time of writing is that of all files of a run: parts, checksums, manifest, each synced to the
disk; the time of reading is that of a resumed run, without building the engines.
"""

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from subsoil_ros.coupling.checkpoints import CheckpointWriter, CouplingState, restore_engine
from subsoil_ros.coupling.energy_account import InterfaceWork
from subsoil_ros.coupling.engines import build_motion_source, build_soil, soil_state
from subsoil_ros.coupling.protocol import MECHANISM, SOIL
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.recording.checkpoint import newest_valid

SCENE = Path(__file__).parents[1] / "config/scenes/subsoiler_1s300_as_printed.yaml"
CASES = {"grid": (), "more pairs than a dense bed": ("soil.skin_m=0.0068",)}


def main() -> int:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path())
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    results = [measure(name, CASES[name], args.folder, args.repeats) for name in CASES]
    if args.json:
        print(json.dumps(results, indent=1))
        return 0
    for row in results:
        print(
            f"{row['case']}: {row['particle_count']} particles, {row['listed_pair_count']} listed pairs, "
            f"{row['size_bytes'] / 1e6:.1f} MB, written in {row['write_s']:.2f} s "
            f"({row['write_least_s']:.2f} to {row['write_most_s']:.2f}), read in {row['read_s']:.2f} s"
        )
    return 0


def measure(name: str, overrides: tuple[str, ...], place: Path, repeats: int) -> dict[str, Any]:
    """Writes and reads the same state `repeats` times."""
    resolved = load_scene(SCENE, overrides)
    motion_source, soil = build_motion_source(resolved), build_soil(resolved, 1)
    assert soil is not None
    motions = motion_source.initial_motions()
    wrenches = soil.start(motions)
    writes, reads = [], []
    with tempfile.TemporaryDirectory(dir=place) as folder:
        checkpoint_writer = CheckpointWriter(Path(folder), resolved, "benchmark")
        for tick in range(repeats):
            start = time.monotonic()
            checkpoint_writer.keep(tick, MECHANISM, motion_source)
            checkpoint_writer.keep(tick, SOIL, soil)
            checkpoint_writer.commit(CouplingState(tick, motions, wrenches, InterfaceWork()))
            writes.append(time.monotonic() - start)
            start = time.monotonic()
            found, _ = newest_valid(Path(folder), resolved.scene_hash)
            restore_engine(soil, found, SOIL)
            reads.append(time.monotonic() - start)
    return {
        "case": name,
        "particle_count": soil_state(soil, "", 0, 0).particle_count,
        "listed_pair_count": len(soil.state_arrays()["pairs.neighbour"]),
        "size_bytes": found.size_bytes,
        "write_s": statistics.median(writes),
        "write_least_s": min(writes),
        "write_most_s": max(writes),
        "read_s": statistics.median(reads),
    }


if __name__ == "__main__":
    raise SystemExit(main())
