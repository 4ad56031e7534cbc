"""Cost of a field: wall time per metre, and CPU time of its shifts.

    python -m benchmarks.field [--scene field_tine] [--radii-mm 15 20 10] [--threads 2] [--out FILE.json]

Metres: `subsoil run` as nodes and in direct mode, each twice; one run is LONGER_S longer, and its extra time
is divided by the travel of that time. Shifts: the engine in this process on one thread, CPU time
within shifts of the window and without them, at the first radius. Blocks are prepared before.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from subsoil_ros.coupling.engines import build_motion_source, build_soil
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.loading.loader import load_scene

SCENES = Path(__file__).parents[1] / "config/scenes"

SHORT_S, LONGER_S, SPEED_M_PER_S = 2.0, 1.0, 0.5
"""Time of the shorter run: the window is then whole; what the longer one has more; speed of the scene."""

SHIFTED_S = 6.0
"""Of the run whose shifts are timed (chosen: some 30)."""


def wall_s(scene: Path, radius_mm: float, mode: str, threads: int, duration_s: float) -> float:
    """Of the ticks of a run."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        changes = {"duration_s": duration_s, "soil.particles.radius_m": 1e-3 * radius_mm}
        sets = [part for key, value in changes.items() for part in ("--set", f"{key}={value:g}")]
        if load_scene(scene).scene.stop_when is not None:
            sets += ["--set", "stop_when=null"]
        command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", str(scene), "--out", str(out)]
        command += ["--mode", mode, "--threads", str(threads), *sets]
        subprocess.run(command, check=True, capture_output=True)
        return float(json.loads((out / "summary.json").read_text())["run"]["wall_s"])


def shifts(scene: Path, radius_mm: float) -> dict[str, Any]:
    """CPU time of shifts and of all else."""
    resolved = load_scene(scene, {"soil.particles.radius_m": 1e-3 * radius_mm, "duration_s": SHIFTED_S})
    source, engine = build_motion_source(resolved), build_soil(resolved, 1)
    if not isinstance(engine, SoilEngine) or engine.window is None:
        raise SystemExit(f"{scene}: has no soil.window; name a scene that has one")
    spent: list[float] = []
    shift = engine.shift

    def timed(rear: int, front: int) -> None:
        before = time.process_time()
        shift(rear, front)
        spent.append(time.process_time() - before)

    engine.shift = timed  # type: ignore[method-assign]
    wrenches = engine.start(source.initial_motions())
    start, particles = time.process_time(), 0
    for tick in range(resolved.timing.tick_count):
        wrenches = engine.advance(tick, source.advance(tick, wrenches))
        particles += engine.particle_count
    whole = time.process_time() - start
    steps = particles * resolved.timing.soil_steps
    return {
        "radius_mm": radius_mm,
        "shifts": len(spent),
        "cpu_ms_per_shift": 1e3 * sum(spent) / len(spent),
        "particle_steps_per_s": steps / whole,
        "without_shifts": steps / (whole - sum(spent)),
        "part": sum(spent) / whole,
    }


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.field", description=main.__doc__)
    parser.add_argument("--scene", default="field_tine")
    parser.add_argument("--radii-mm", nargs="+", type=float, default=[15.0, 20.0, 10.0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, metavar="FILE.json")
    args = parser.parse_args()
    scene = SCENES / f"{args.scene}.yaml"
    found: dict[str, Any] = {"shifts": shifts(scene, args.radii_mm[0]), "minutes_per_metre": {}}
    of = found["shifts"]
    print(
        f"a shift takes {of['cpu_ms_per_shift']:.1f} ms of CPU time ({of['shifts']} shifts), "
        f"{of['part']:.1%} of all: {1e-6 * of['particle_steps_per_s']:.2f} million particle-steps per s, "
        f"{1e-6 * of['without_shifts']:.2f} without shifts\n"
    )
    print("| radius mm | direct, min per m | nodes, min per m |\n|---|---|---|", flush=True)
    for radius in args.radii_mm:
        wall_s(scene, radius, "direct", args.threads, 0.1)  # its block, and kernels
        minutes = []
        for mode in ("direct", "nodes"):
            short, long = (
                wall_s(scene, radius, mode, args.threads, duration_s)
                for duration_s in (SHORT_S, SHORT_S + LONGER_S)
            )
            minutes.append((long - short) / (LONGER_S * SPEED_M_PER_S) / 60.0)
        found["minutes_per_metre"][f"{radius:g}"] = dict(zip(("direct", "nodes"), minutes, strict=True))
        print(f"| {radius:g} | {minutes[0]:.2f} | {minutes[1]:.2f} |", flush=True)
    if args.out is not None:
        args.out.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
