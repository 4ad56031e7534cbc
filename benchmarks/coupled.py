"""Cost of lockstep for a scene: wall time of the same ticks in direct mode and as separate nodes, by turns.

    python benchmarks/coupled.py [SCENE] [--ticks N] [--threads N] [--rounds N] [--set key=value ...]

Both modes record. Wall time from the first tick to the last, without start-up; the state at the end must be
the same, bit for bit. One warm-up of each before.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from subsoil_ros.loading.loader import load_scene

FULL = Path(__file__).parents[1] / "config" / "scenes" / "subsoiler_1s300.yaml"
MODES = ("direct", "nodes")


def summary_of(mode: str, scene: str, threads: int, overrides: list[str]) -> dict[str, Any]:
    """What a run of these ticks says of itself."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", scene, "--mode", mode]
        command += ["--out", str(out), "--threads", str(threads)]
        command += [word for override in overrides for word in ("--set", override)]
        subprocess.run(command, check=True, capture_output=True)
        summary: dict[str, Any] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        return summary


def main() -> None:
    """Runs the rounds and prints one JSON object."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", nargs="?", default=str(FULL))
    parser.add_argument("--ticks", type=int, default=1000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    args = parser.parse_args()
    interval_s = load_scene(args.scene, args.overrides).timing.communication_step_s
    overrides = [*args.overrides, f"duration_s={args.ticks * interval_s!r}"]
    wall_s: dict[str, list[float]] = {mode: [] for mode in MODES}
    digests = set()
    for turn in range(args.rounds + 1):
        for mode in MODES:
            summary = summary_of(mode, args.scene, args.threads, overrides)
            digests.add(json.dumps(summary["run"]["state_sha256"], sort_keys=True))
            if turn > 0:
                wall_s[mode].append(summary["run"]["wall_s"])
    direct, nodes = (statistics.median(wall_s[mode]) for mode in MODES)
    print(
        json.dumps(
            {
                "scene": args.scene,
                "ticks": args.ticks,
                "threads": args.threads,
                "wall_s": wall_s,
                "nodes_over_direct": nodes / direct,
                "us_per_tick_more": 1e6 * (nodes - direct) / args.ticks,
                "same_state": len(digests) == 1,
            }
        )
    )


if __name__ == "__main__":
    main()
