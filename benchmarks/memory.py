"""Resident memory of every process of a run over its ticks: it must not grow with their number.

`python benchmarks/memory.py [--ticks 1000000] [--modes direct nodes] [--scene FILE] [--json]` runs
the machine without soil (or FILE) in ticks of 0.1 ms and prints, for each process, the memory in use after
the first tenth of the run, at its end, and the growth per million ticks.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import psutil

INTERVAL_NS = 100_000
SCENE = Path(__file__).parents[1] / "config/scenes/mechanism_only.yaml"


def main() -> int:
    """Runs and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--modes", nargs="+", default=["direct", "nodes"])
    parser.add_argument("--scene", type=Path, default=SCENE)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    results = [row for mode in args.modes for row in measure(args.scene, mode, args.ticks)]
    if args.json:
        print(json.dumps(results, indent=1))
        return 0
    print(f"{'mode':8}{'process':12}{'after a tenth MB':>18}{'end MB':>10}{'MB per million ticks':>22}")
    for row in results:
        print(
            f"{row['mode']:8}{row['process']:12}{row['tenth_mb']:18.1f}{row['end_mb']:10.1f}"
            f"{row['growth_mb_per_million']:22.1f}"
        )
    return 0


def measure(scene: Path, mode: str, ticks: int) -> list[dict[str, object]]:
    """One run; a row for each of its processes."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        changes = {
            "duration_s": ticks * INTERVAL_NS * 1e-9,
            "coupling.communication_step_ns": INTERVAL_NS,
            "record.series_ticks": 100,
        }
        sets = [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
        command = ["run", str(scene), "--out", str(out), "--mode", mode, *sets]
        process = subprocess.Popen(
            [sys.executable, "-m", "subsoil_ros.cli.main", *command],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        assert process.stderr is not None
        threading.Thread(target=process.stderr.read, daemon=True).start()
        samples: dict[int, list[tuple[int, float]]] = {}  # by process: (bytes of the bag, MB)
        names: dict[int, str] = {}
        while process.poll() is None:
            written = sum(path.stat().st_size for path in out.glob("bag/*.mcap"))
            whole = (out / "bag" / "metadata.yaml").exists()
            for found in _with_children(process.pid) if written > 0 and not whole else ():
                with suppress(psutil.NoSuchProcess):  # it has ended
                    names[found.pid] = _name(found)
                    samples.setdefault(found.pid, []).append((written, 1e-6 * found.memory_info().rss))
            time.sleep(0.5)
        if process.returncode:
            raise SystemExit(f"{mode}: ended with status {process.returncode}")
    return [_row(mode, names[pid], ticks, rows) for pid, rows in samples.items()]


def _row(mode: str, name: str, ticks: int, rows: list[tuple[int, float]]) -> dict[str, object]:
    last = rows[-1][0]  # the bag grows by as much in every tick, so its size tells the tick
    tenth = next(resident for written, resident in rows if written >= 0.1 * last)
    grown = rows[-1][1] - tenth
    return {
        "mode": mode,
        "process": name,
        "tenth_mb": tenth,
        "end_mb": rows[-1][1],
        "growth_mb_per_million": grown / (0.9 * ticks) * 1e6,
    }


def _with_children(pid: int) -> list[psutil.Process]:
    try:
        process = psutil.Process(pid)
        return [process, *process.children()]
    except psutil.NoSuchProcess:
        return []


def _name(process: psutil.Process) -> str:
    """Of the node that it is."""
    words = process.cmdline()
    if "subsoil_ros.cli.main" in words:
        return "subsoil"
    name = next((word for word in words if word.startswith("subsoil_ros.ros.nodes.")), "")
    return name.rpartition(".")[2].removesuffix("_node") or "other"


if __name__ == "__main__":
    raise SystemExit(main())
