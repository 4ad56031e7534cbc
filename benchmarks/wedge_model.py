"""Cost of the wedge model: CPU time per simulated second beside particles, and real-time factor as nodes.

    python benchmarks/wedge_model.py [--nodes SECONDS] [--particles TICKS] [--pairs N]

Both machine scenes run in direct mode with their record. CPU time is measured, so that other load does not
count. The scene with particles runs for a few ticks, since its step costs the same all along. Pairs of the
presets `fine` and `real_time` of field_tine run by turns, as CPU times scatter by half. As nodes (four
processes over DDS, 1 ms exchange), wall time is measured, which other load raises: check the printed load.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.observer import RunWatch
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import CouplingReport
from subsoil_ros.recording.bag_reader import BagReader

SCENES = Path(__file__).parents[1] / "config" / "scenes"
FINE_S, WEDGE_S, WEDGE_RUNS = 0.6, 12.8, 7  # simulated, of a pair: the shorter runs count by their median


def cpu_s_per_simulated_s(resolved: ResolvedScene) -> float:
    """Of a direct run with its bag; the first tick, which compiles and prepares, is left out."""
    marks: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        watch = RunWatch(lambda tick: marks.append(time.process_time()))
        simulate(RunSettings(resolved, bag=Path(folder) / "bag"), observer=watch)
        marks[-1] = time.process_time()
    return (marks[-1] - marks[0]) / ((len(marks) - 1) * resolved.timing.communication_step_s)


def compare(name: str, particles: str, wedge: str, ticks: int, *overrides: str) -> None:
    """Prints the CPU time of two scenes and their ratio."""
    first = load_scene(SCENES / particles)
    duration = ticks * first.timing.communication_step_s
    one = cpu_s_per_simulated_s(load_scene(SCENES / particles, [f"duration_s={duration!r}"]))
    two = cpu_s_per_simulated_s(load_scene(SCENES / wedge, overrides))
    print(f"{name}: {one:.1f} s with particles, {two:.3f} s with the wedge model, {one / two:.0f} times")


def presets(pairs: int) -> None:
    """Prints CPU times of `fine` and `real_time`, and how many times faster the second is."""
    fine = load_scene("field_tine", ["preset=fine", "stop_when=null", f"duration_s={FINE_S}"])
    wedge = load_scene("field_tine", ["preset=real_time", "stop_when=null", f"duration_s={WEDGE_S}"])
    cpu_s_per_simulated_s(wedge)  # loads kernels and files
    ratios = []
    for _ in range(pairs):
        one = cpu_s_per_simulated_s(fine)
        two = statistics.median(cpu_s_per_simulated_s(wedge) for _ in range(WEDGE_RUNS))
        ratios.append(one / two)
        print(f"field_tine: {one:.1f} s with fine, {two:.3f} s with real_time, {ratios[-1]:.0f} times")
    print(f"times faster: {statistics.median(ratios):.0f}, {min(ratios):.0f} to {max(ratios):.0f}")


def run_nodes(seconds: float, out: Path) -> float:
    """Runs the machine as nodes; returns the CPU time of all processes, start-up included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    scene = str(SCENES / "subsoiler_1s300_wedge.yaml")
    command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", scene, "--mode", "nodes"]
    command += ["--out", str(out), "--set", f"duration_s={seconds!r}"]
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def real_time(seconds: float) -> None:
    """Prints real-time factor, jitter and CPU time of the machine as nodes."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        load = os.getloadavg()[0]
        cpu_s = run_nodes(seconds, out) - run_nodes(0.5, Path(folder) / "short")
        reports = list(BagReader(out / "bag").records(CouplingReport))[1:]  # that of t = 0 has no wall time
    wall = np.array([report.wall_time_s for report in reports])
    simulated = np.array([report.end_time_ns * 1e-9 for report in reports])
    per_tick = np.diff(wall) / np.diff(simulated)
    late = wall - wall[0] - (simulated - simulated[0])
    factor = (simulated[-1] - simulated[0]) / (wall[-1] - wall[0])
    print(
        f"nodes, 1 ms exchange: real-time factor {factor:.2f}, {cpu_s / (seconds - 0.5):.2f} s of CPU per "
        "simulated second, all processes; wall over simulated time of each "
        f"{1e3 * (simulated[1] - simulated[0]):.0f} ms: median {np.median(per_tick):.2f}, 99th percentile "
        f"{np.percentile(per_tick, 99):.2f}, largest {per_tick.max():.2f}; furthest behind real time "
        f"{1e3 * max(late.max(), 0.0):.0f} ms; load before {load:.1f}, {len(os.sched_getaffinity(0))} cores"
    )


def main() -> None:
    """Runs both parts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--nodes", type=float, default=4.0, metavar="SECONDS", help="simulated seconds as nodes; 0: none"
    )
    parser.add_argument(
        "--particles", type=int, default=60, metavar="TICKS", help="ticks of the scene with particles"
    )
    parser.add_argument("--pairs", type=int, default=5, help="pairs of fine and real_time; 0: none")
    args = parser.parse_args()
    if args.particles > 0:
        compare(
            "machine, full bin (CPU per simulated second)",
            "subsoiler_1s300.yaml",
            "subsoiler_1s300_wedge.yaml",
            args.particles,
            "duration_s=2.0",
        )
    if args.pairs > 0:
        presets(args.pairs)
    if args.nodes > 0.0:
        real_time(args.nodes)


if __name__ == "__main__":
    main()
