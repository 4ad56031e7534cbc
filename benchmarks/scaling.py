"""How cost grows: particles, threads, tools on one frame, metres of field, bodies of a mechanism.

    python -m benchmarks.scaling [--only particles threads tools field bodies] [--out FOLDER]

Prints a table for each, and draws cost over the ideal, where what is doubled costs twice or, of threads,
takes half. Particles, threads: a plate dragged through grids of the paper's soil. Tools: flat blades side by
side in one field; the ideal is the time with one and what each further one of the first four adds. Field: a
shallow blade in a window; CPU time per metre, and memory of the process, after so many metres. Bodies: chains
of rods.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numba

from benchmarks.mechanism import chain_costs
from benchmarks.soil_cases import scaling_cases
from benchmarks.throughput import measure
from subsoil_ros import load_scene
from subsoil_ros.coupling.engines import build_motion_source, build_soil
from subsoil_ros.loading.loader import ResolvedScene

Point = tuple[float, float, str]
"""What grows; cost over the ideal; more to print."""

COUNTS = (10_000, 100_000, 1_000_000)
TOOLS = (1, 4, 8, 12)
METRES = (1.0, 10.0, 50.0, 200.0)
LARGEST_CHAIN = 1000

SPEED_M_PER_S = 2.0
"""Of the blades (chosen: fast, so that 200 m take minutes)."""


def particles() -> list[Point]:
    """CPU time of a particle-step."""
    with tempfile.TemporaryDirectory() as folder:
        costs = [measure(case, 1, 3) for case in scaling_cases(Path(folder), COUNTS)]
    first = costs[0].particle_steps_per_cpu_s
    return [
        (
            cost.particle_count,
            first / cost.particle_steps_per_cpu_s,
            f"{1e-6 * cost.particle_steps_per_cpu_s:.1f} million/s, {cost.bytes_per_particle:.0f} bytes",
        )
        for cost in costs
    ]


def threads() -> list[Point]:
    """Wall time of a step, times the threads."""
    most = numba.config.NUMBA_NUM_THREADS
    counts = [count for count in (1, 2, 4, 8, 16) if count <= most]
    with tempfile.TemporaryDirectory() as folder:
        (case,) = scaling_cases(Path(folder), (100_000,))
        rates = [measure(case, count, 3).particle_steps_per_wall_s for count in counts]
    return [
        (count, count * rates[0] / rate, f"{1e-6 * rate:.1f} million/s")
        for count, rate in zip(counts, rates, strict=True)
    ]


def blades(count: int, *, depth_m: float, width_m: float, metres: float) -> ResolvedScene:
    """`count` flat blades side by side, in loam of 20 mm, in one field."""
    apart = 0.3
    tools = {
        f"blade{k}": {
            "lateral_m": apart * (k - 0.5 * (count - 1)),
            "path": {"start_x_m": -0.05, "start_z_m": -depth_m, "speed_x_m_per_s": SPEED_M_PER_S},
            "blade": {"rake_deg": 45.0, "width_m": 0.06, "height_m": depth_m + 0.1},
        }
        for k in range(count)
    }
    document = {
        "name": "blades",
        "duration_s": metres / SPEED_M_PER_S,
        "soil": {
            "material": "loam",
            "bin": {"length_m": 210.0, "width_m": width_m, "depth_m": depth_m + 0.1, "sides": "held"},
            "window": {},
            "particles": {"radius_m": 0.02},
            "bed": {"seed": 1},
        },
        "tools": tools,
        "coupling": {"communication_step_ns": 500000, "force": "tick_mean"},
    }
    return load_scene(document)


def marks(resolved: ResolvedScene, metres: Sequence[float]) -> list[tuple[float, float]]:
    """CPU time [s] from after the first tenth of a metre up to each of these ways, without a record, and the
    memory of the process then [MB]."""
    source, soil = build_motion_source(resolved), build_soil(resolved, 1)
    assert soil is not None
    wrenches, found = soil.start(source.initial_motions()), []
    per_metre = resolved.timing.tick_count / metres[-1]
    ends = [round(per_metre * metre) - 1 for metre in metres]
    for tick in range(resolved.timing.tick_count):
        wrenches = soil.advance(tick, source.advance(tick, wrenches))
        if tick == round(0.1 * per_metre):
            begin = time.process_time()
        if tick in ends:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            found.append((time.process_time() - begin, 1e-6 * pages * os.sysconf("SC_PAGE_SIZE")))
    return found


def tools() -> list[Point]:
    """CPU time of the soil with so many tools."""
    ways = [marks(blades(count, depth_m=0.15, width_m=4.2, metres=0.6), (0.6,))[0][0] for count in TOOLS]
    each = (ways[1] - ways[0]) / (TOOLS[1] - TOOLS[0])
    return [
        (count, way / (ways[0] + (count - 1) * each), f"{way:.1f} s")
        for count, way in zip(TOOLS, ways, strict=True)
    ]


def field() -> list[Point]:
    """CPU time of a metre, and memory."""
    resolved = blades(1, depth_m=0.06, width_m=0.4, metres=METRES[-1])
    spent = marks(resolved, METRES)
    first = spent[0][0] / (METRES[0] - 0.1)
    points, before, way = [], 0.0, 0.1
    for metre, (at, memory) in zip(METRES, spent, strict=True):
        cost = (at - before) / (metre - way)
        points.append((metre, cost / first, f"{cost:.2f} s a metre, {memory:.0f} MB"))
        before, way = at, metre
    return points


def bodies() -> list[Point]:
    """CPU time of a step of a body."""
    costs = [cost for cost in chain_costs(LARGEST_CHAIN) if cost.bodies >= 10]
    first = costs[0].us_per_step / costs[0].bodies
    return [
        (cost.bodies, cost.us_per_step / cost.bodies / first, f"{cost.us_per_step:.0f} us") for cost in costs
    ]


PARTS: dict[str, Callable[[], list[Point]]] = {
    "particles": particles, "threads": threads, "tools": tools, "field": field, "bodies": bodies
}  # fmt: skip


def draw(found: dict[str, list[Point]], path: Path) -> None:
    """Cost over the ideal, a panel for each."""
    from matplotlib.figure import Figure

    figure = Figure((2.2 * len(found), 2.4), layout="constrained")
    axes: Any = figure.subplots(1, len(found), sharey=True, squeeze=False)
    for axis, (name, points) in zip(axes[0], found.items(), strict=True):
        axis.semilogx([point[0] for point in points], [point[1] for point in points], "o-", color="#8c5a2b")
        axis.axhline(1.0, color="0.6", lw=0.8)
        axis.set(xlabel="metres of field" if name == "field" else name, ylim=(0.0, 2.0))
    axes[0, 0].set_ylabel("cost over the ideal")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Prints the tables and draws them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    found = {}
    for name in args.only:
        found[name] = PARTS[name]()
        print(f"\n| {name} | cost over the ideal | |\n|---|---|---|")
        for count, cost, more in found[name]:
            print(f"| {count:,.0f} | {cost:.2f} | {more} |", flush=True)
    if args.out is not None:
        draw(found, args.out / "scaling.png")


if __name__ == "__main__":
    main()
