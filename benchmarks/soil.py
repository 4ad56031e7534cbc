"""Throughput of the soil engine, its phases, threads and size, memory, and what bounds it.

python -m benchmarks.soil [--quick] [--large] [--json]
"""

import argparse
import dataclasses
import json
import os
import resource
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.roofline import flops_per_s, roofline, triad_bytes_per_s
from benchmarks.soil_cases import Case, scaling_cases, throughput_cases
from benchmarks.throughput import Throughput, measure, phase_parts
from subsoil_ros.api.prepare_bed import prepare_bed_first
from subsoil_ros.cli.output import say, table
from subsoil_ros.cli.progress import KernelAnnouncer, bed_progress
from subsoil_ros.dem.bed import Bed
from subsoil_ros.dem.build import prepare_bed

SCALING_COUNTS, LARGEST_COUNT = (10_000, 100_000), 1_000_000


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures and prints tables, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quick", action="store_true", help="only beds of about 9,000 particles")
    parser.add_argument("--large", action="store_true", help="up to 1,000,000 particles")
    args = parser.parse_args(arguments)
    repeats = 3 if args.quick else 5
    with tempfile.TemporaryDirectory() as place, KernelAnnouncer():
        folder = Path(place)
        lines, phases = [], {}
        for case in throughput_cases(folder, quick=args.quick):
            bed = _bed(case)
            say(f"measuring {case.name}")
            lines.append(measure(case, 1, repeats, bed))
            phases[case.name] = phase_parts(case, bed)
        threads = _threads(case, bed, lines[-1], repeats)  # of the last case, the largest
        counts = (SCALING_COUNTS[0],) if args.quick else SCALING_COUNTS
        scaling = []
        for case in scaling_cases(folder, (*counts, LARGEST_COUNT) if args.large else counts):
            say(f"measuring {case.name}")
            scaling.append(measure(case, 1, repeats, _bed(case)))
    bandwidth, flops = triad_bytes_per_s(), flops_per_s()
    result = {
        "throughput": [dataclasses.asdict(line) for line in lines],
        "phases": phases,
        "threads": [dataclasses.asdict(line) for line in threads],
        "thread_speed_up": _speed_up(threads),
        "scaling": [dataclasses.asdict(line) for line in scaling],
        "peak_rss_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "machine": {"triad_bytes_per_s": bandwidth, "flops_per_s": flops},
        "roofline": [dataclasses.asdict(roofline(line, bandwidth, flops)) for line in lines],
    }
    if args.json:
        print(json.dumps(result))
    else:
        _print(result, lines, threads, scaling)


def _bed(case: Case) -> Bed:
    prepare_bed_first(case.resolved, 1, bed_progress)
    return prepare_bed(case.resolved)


def _threads(case: Case, bed: Bed, one: Throughput, repeats: int) -> list[Throughput]:
    """A case with one thread and with two, where there are two cores."""
    if len(os.sched_getaffinity(0)) < 2:
        return [one]
    say(f"measuring {case.name}, two threads")
    return [one, measure(case, 2, repeats, bed)]


def _speed_up(threads: list[Throughput]) -> float | None:
    """Wall time of one thread over that of two."""
    if len(threads) < 2:
        return None
    return threads[1].particle_steps_per_wall_s / threads[0].particle_steps_per_wall_s


def _print(
    result: dict[str, Any], lines: list[Throughput], threads: list[Throughput], scaling: list[Throughput]
) -> None:
    console = Console(width=None if sys.stdout.isatty() else 180)
    console.print(_speeds("soil engine, one thread", lines))
    phases = table("part of the CPU time, %", ("case", *next(iter(result["phases"].values()))))
    for name, parts in result["phases"].items():
        phases.add_row(name, *(f"{100.0 * part:.1f}" for part in parts.values()))
    console.print(phases)
    console.print(_speeds("one thread and two", threads))
    if result["thread_speed_up"] is not None:
        console.print(f"two threads are {result['thread_speed_up']:.2f} times as fast as one (wall time)")
    console.print(_speeds("cost against number of particles", scaling))
    first, last = scaling[0].particle_steps_per_cpu_s, scaling[-1].particle_steps_per_cpu_s
    console.print(
        f"a particle-step costs {100.0 * (first / last - 1.0):+.0f} % from {scaling[0].particle_count:,} to "
        f"{scaling[-1].particle_count:,} particles; peak memory {result['peak_rss_bytes'] / 1e9:.2f} GB"
    )
    machine = result["machine"]
    console.print(
        f"one core of this machine: {machine['triad_bytes_per_s'] / 1e9:.1f} GB/s (triad), "
        f"{machine['flops_per_s'] / 1e9:.1f} Gflop/s (float64 multiply-add)"
    )
    headings = ("case", "bytes", "flops", "by bandwidth M/s", "by arithmetic M/s", "reached of the lower, %")
    bounds = table("what bounds a particle-step", headings)
    for bound in result["roofline"]:
        bounds.add_row(
            bound["name"],
            f"{bound['bytes_per_particle_step']:.0f}",
            f"{bound['flops_per_particle_step']:.0f}",
            f"{1e-6 * bound['bandwidth_bound_per_s']:.1f}",
            f"{1e-6 * bound['arithmetic_bound_per_s']:.1f}",
            f"{100.0 * bound['part_reached']:.0f}",
        )
    console.print(bounds)


def _speeds(title: str, lines: list[Throughput]) -> Table:
    headings = (
        "case", "bed", "particles", "pairs listed", "contacts", "skin mm", "rebuilds", "steps", "threads",
        "M particle-steps per CPU s", "per wall s", "bytes",
    )  # fmt: skip
    speeds = table(title, headings)
    for line in lines:
        low, middle, high = (
            1e-6 * speed
            for speed in (
                line.particle_steps_per_cpu_s_min,
                line.particle_steps_per_cpu_s,
                line.particle_steps_per_cpu_s_max,
            )
        )
        speeds.add_row(
            line.name,
            line.bed_hash,
            f"{line.particle_count:,}",
            f"{line.listed_pairs_per_particle:.2f}",
            f"{line.contacts_per_particle:.2f}",
            f"{1e3 * line.skin_m:g}",
            str(line.rebuild_count),
            str(line.steps),
            str(line.threads),
            f"{middle:.2f} ({low:.2f} to {high:.2f})",
            f"{1e-6 * line.particle_steps_per_wall_s:.2f}",
            f"{line.bytes_per_particle:.0f}",
        )
    return speeds


if __name__ == "__main__":
    main()
