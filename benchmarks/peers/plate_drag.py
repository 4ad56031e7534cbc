"""Force on a vertical plate dragged through a dry bed, here and in LIGGGHTS, over seeds of the bed.

    python -m benchmarks.peers.plate_drag [--seeds N] [--json]

Both codes get the same particles, law, plate (an STL file) and step. Trajectories of single particles diverge
after some contacts, so only means over the steady part of the path are compared, with their scatter over
seeds.
"""

import argparse
import json
import math
import sys
import tempfile
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


def compare(seeds: int) -> dict[str, Any]:
    """Mean forces by code and seed; the difference of the means over the scatter that seeds alone give it."""
    codes = [subsoil, *([liggghts] if liggghts.find() else [])]
    forces: dict[str, list[float]] = {code.NAME: [] for code in codes}
    counts = []
    with tempfile.TemporaryDirectory() as folder:
        stl = Path(folder) / "plate.stl"
        box = trimesh.creation.box(PLATE_M)
        box.apply_translation((START_X_M, 0.0, 0.5 * PLATE_M[2] - DEPTH_M))
        box.export(stl)
        for seed in range(seeds):
            job = drag_job(bed_with_hole(seed), stl)
            counts.append(len(job.positions_m))
            for code in codes:
                forces[code.NAME].append(steady_newton(code.run(job)))
                print(f"seed {seed}, {code.NAME}: {forces[code.NAME][-1]:.2f} N", file=sys.stderr, flush=True)
    result: dict[str, Any] = {"particle_counts": counts, "force_newton": forces}
    if len(codes) == 2 and seeds > 1:
        ours, theirs = (np.array(forces[code.NAME]) for code in codes)
        scatter = math.sqrt((ours.var(ddof=1) + theirs.var(ddof=1)) / seeds)
        result["difference_newton"] = float(ours.mean() - theirs.mean())
        result["standard_error_newton"] = scatter
    return result


def main() -> None:
    """Prints the forces."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="beds (default 3)")
    args = parser.parse_args()
    if not liggghts.find():
        print("LIGGGHTS: not installed, left out", file=sys.stderr)
    with KernelAnnouncer():
        result = compare(args.seeds)
    if args.json:
        print(json.dumps(result))
        return
    for name, forces in result["force_newton"].items():
        spread = f" +- {np.std(forces, ddof=1):.2f}" if len(forces) > 1 else ""
        print(f"{name:12} mean {np.mean(forces):.2f}{spread} N   {[round(force, 2) for force in forces]}")
    if "difference_newton" in result:
        print(
            f"difference of the means {result['difference_newton']:.2f} N, standard error from the scatter "
            f"of seeds {result['standard_error_newton']:.2f} N"
        )


if __name__ == "__main__":
    main()
