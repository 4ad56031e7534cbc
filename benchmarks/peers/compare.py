"""Particle-steps per CPU second of this engine and of the peers that are installed, on the same beds.

    python -m benchmarks.peers.compare [--quick] [--json]

Same positions and velocities, same law (`linear` of `benchmarks.soil`), same steps, one core. The codes
run by turns, so that other load affects all of them; medians are compared. The kinetic energy left at the end
shows whether they computed the same.
"""

import argparse
import json
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.soil_cases import Case, stirred_velocities, throughput_cases
from benchmarks.throughput import bed_hash
from subsoil_ros.api.prepare_bed import prepare_bed_first
from subsoil_ros.cli.progress import KernelAnnouncer, bed_progress
from subsoil_ros.dem.build import prepare_bed

from . import lammps_granular, liggghts, subsoil, yade_viscoelastic
from .job import Job, Result, kinetic_joule

PEERS = (liggghts, lammps_granular, yade_viscoelastic)


def job_of(case: Case) -> tuple[Job, str]:
    """A case as a job, and the hash of its bed."""
    prepare_bed_first(case.resolved, 1, bed_progress)
    bed = prepare_bed(case.resolved)
    count = len(bed.positions_m)
    velocities = stirred_velocities(count)
    job = Job(bed.positions_m, velocities, np.zeros((count, 3)), bed.lower_m, bed.upper_m, case.steps)
    return job, bed_hash(bed)


def compare(case: Case, repeats: int) -> list[dict[str, Any]]:
    """One line for every code that is there, ours first."""
    job, hashed = job_of(case)
    codes = [subsoil, *(peer for peer in PEERS if peer.find())]
    results: dict[str, list[Result]] = {code.NAME: [] for code in codes}
    for _ in range(repeats):
        for code in codes:
            results[code.NAME].append(code.run(job))
    work = len(job.positions_m) * job.steps
    ours = statistics.median(result.cpu_s for result in results[subsoil.NAME])
    lines = []
    for name, found in results.items():
        cpu_s = [result.cpu_s for result in found]
        lines.append(
            {
                "case": case.name,
                "bed_hash": hashed,
                "code": name,
                "particle_count": len(job.positions_m),
                "steps": job.steps,
                "skin_m": job.skin_m,
                "rebuild_count": found[-1].rebuild_count,
                "repeats": repeats,
                "particle_steps_per_cpu_s": work / statistics.median(cpu_s),
                "particle_steps_per_cpu_s_min": work / max(cpu_s),
                "particle_steps_per_cpu_s_max": work / min(cpu_s),
                "ours_times_faster": statistics.median(cpu_s) / ours,
                "end_kinetic_energy_joule": kinetic_joule(job, found[-1]),
            }
        )
    return lines


def main() -> None:
    """Prints a table, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON list instead of a table")
    parser.add_argument("--quick", action="store_true", help="one short run each, as a check that it works")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="runs of each code (default 5)")
    args = parser.parse_args()
    for peer in PEERS:
        if not peer.find():
            print(f"{peer.NAME}: not installed, left out", file=sys.stderr)
    lines = []
    with tempfile.TemporaryDirectory() as folder, KernelAnnouncer():
        for case in throughput_cases(Path(folder), quick=True):
            if case.stirred:
                lines += compare(case, 1 if args.quick else args.repeats)
    if args.json:
        print(json.dumps(lines))
        return
    print(f"{'case':32}{'code':14}{'million particle-steps per CPU s':>34}{'ours/it':>9}", end="")
    print(f"{'rebuilds':>10}{'end energy J':>14}")
    for line in lines:
        low, middle, high = (line[f"particle_steps_per_cpu_s{kind}"] / 1e6 for kind in ("_min", "", "_max"))
        speed = f"{middle:.2f} ({low:.2f} to {high:.2f})"
        print(f"{line['case']:32}{line['code']:14}{speed:>34}{line['ours_times_faster']:>9.2f}", end="")
        print(f"{line['rebuild_count'] or '-':>10}{line['end_kinetic_energy_joule']:>14.4g}")


if __name__ == "__main__":
    main()
