"""Cost of a soil in LAMMPS by its particles and ranks, beside this engine on as many threads.

    python -m benchmarks.ranks [--particles 100000 1000000] [--ranks 1 2] [--steps 100] [--engines lammps own]

A bed of the law `linear` of benchmarks.soil, laid out as a grid and stirred; no tools. Time is wall time of
the steps, memory the peak of every process, added up.
"""

import argparse
import dataclasses
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.soil_cases import linear_case, stirred_velocities
from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.ros.process.mpi import under_mpi

ACROSS = 40
"""Particles across the bed and in its depth; the rest is its length."""


def measured(particles: int, engine: str, at_once: int, steps: int) -> dict[str, object]:
    """One line, measured in this process and, of LAMMPS, in the ranks that it leads."""
    case = linear_case({"kind": "grid", "spacing_m": "rest"}, (1.0, 1.0, 1.0), steps, "ranks")
    soil = case.resolved.scene.particle_soil
    assert soil is not None
    soil = soil.model_copy(update={"engine": engine, "monitors": None})
    scene = case.resolved.scene.model_copy(update={"soil": soil})
    apart = 2.0 * soil.particles.mean_volume_radius_m
    across = min(ACROSS, round(particles ** (1.0 / 3.0)))
    axes = [apart * (0.5 + np.arange(count)) for count in (particles // across**2, across, across)]
    x, y, z = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    places = np.stack((x, y - 0.5 * apart * across, z - apart * across), axis=1)
    lower = (0.0, -0.5 * apart * across, -apart * across)
    bed = Bed(places, lower, (float(x.max()) + 0.5 * apart, 0.5 * apart * across))
    found = SoilEngine(
        dataclasses.replace(case.resolved, scene=scene), bed, at_once if engine == "own" else 1
    )
    found.place(places, stirred_velocities(len(places)))
    found.start(())
    for tick in range(3):
        found.advance(tick, ())
    start = time.monotonic()
    for tick in range(3, steps + 3):
        found.advance(tick, ())
    wall_s = time.monotonic() - start
    ranks = getattr(found._steps, "_ranks", None)
    own_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    peak_kb = ranks.call("peak_memory_kb") if ranks is not None else own_kb
    found.close()
    return {
        "engine": engine, "at_once": at_once, "particles": len(places), "steps": steps,
        "particle_steps_per_s": len(places) * steps / wall_s, "peak_mb": peak_kb / 1024,
    }  # fmt: skip


def measured_alone(particles: int, engine: str, at_once: int, steps: int) -> dict[str, object]:
    """The same in processes of their own, so that memory is of this line alone."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "line.json"
        words = [str(particles), engine, str(at_once), str(steps), str(out)]
        command = [sys.executable, "-m", "benchmarks.ranks", "--one", *words]
        if engine == "lammps" and at_once > 1:
            command = under_mpi(command, at_once)
        subprocess.run(command, check=True)
        return json.loads(out.read_text())


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--particles", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--engines", nargs="+", default=["own", "lammps"])
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--one", nargs=5, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        particles, engine, at_once, steps, out = args.one
        Path(out).write_text(json.dumps(measured(int(particles), engine, int(at_once), int(steps))))
        return
    lines = [
        measured_alone(particles, engine, at_once, args.steps)
        for particles in args.particles
        for at_once in args.ranks
        for engine in args.engines
    ]
    print(f"{'engine':8}{'ranks or threads':>18}{'particles':>12}", end="")
    print(f"{'million particle-steps/s':>26}{'MB at peak':>12}")
    for line in lines:
        speed = float(str(line["particle_steps_per_s"])) / 1e6
        print(f"{line['engine']:8}{line['at_once']:>18}{line['particles']:>12}{speed:>26.2f}", end="")
        print(f"{float(str(line['peak_mb'])):>12.0f}")


if __name__ == "__main__":
    main()
