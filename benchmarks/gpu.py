"""Cost of soil on a GPU, by kernel and by scene. Needs a GPU (benchmarks/gpu.md).

    python -m benchmarks.gpu throughput [--counts 1e4 1e5 1e6 1e7 3e7] [--repeats 3]
    python -m benchmarks.gpu kernels [--count 1e6]
    python -m benchmarks.gpu exchange
    python -m benchmarks.gpu field [--radii 0.010 0.005 0.0025] [--part 0.01]
    python -m benchmarks.gpu peer [--lammps PROGRAM] [--sides 46 100]
    python -m benchmarks.gpu scene SCENE [--device gpu] [--set KEY=VALUE ...]

Times are wall times. Each table goes to --out (docs/results/gpu), with the GPU and the versions it ran with.

throughput: the paper's law on dense random beds, a plate dragged through at 0.5 m/s, ten soil steps a
tick. A bed of some 8,000 particles or 65,000 is prepared on the GPU and repeated sideways, its sides being
periodic.
kernels: each kernel of a step on such a bed, repeated in one graph.
exchange: a tick of one step, and of ten, on a small bed: the difference is nine steps.
field: a metre of field with r, r/2 and r/4: a dense random bed 2 m long, 0.6 m wide and 0.28 m deep under the
law of the cycle scene, which is scaled with the radius. A part of the metre is run.
peer: a cubic grid of equal spheres that move at random, linear springs, friction, no rolling, beside
LAMMPS with its package KOKKOS on the same GPU, float64 in both (benchmarks/peers/gran_hooke.in).
scene: a run in direct mode, and means of its loads with 95 % intervals, for either device.
"""

import argparse
import csv
import dataclasses
import importlib.metadata
import math
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gpu_drive import STEPS_PER_TICK, Drive, on_gpu, periodic, ticks_of
from benchmarks.peers.lammps_gpu import peer
from benchmarks.run_cache import write_rows
from benchmarks.soil_cases import DENSE, Case, cohesive_case
from subsoil_ros.analysis.intervals import mean_interval
from subsoil_ros.api.execution import execute, machine_name
from subsoil_ros.coupling.engines import build_mechanism
from subsoil_ros.dem.bed import Bed, ignore_progress
from subsoil_ros.dem.engine import SoilEngine
from subsoil_ros.dem.packing.dense_random import prepare_dense
from subsoil_ros.kernel_cache import set_up_numba
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import ToolMotion

OUT = Path(__file__).parents[1] / "docs/results/gpu"
DENSE_BED = Path(__file__).parent / "dense_bed.yaml"

SMALL_BED_M, LARGE_BED_M = (0.60, 0.20, 0.30), (1.80, 0.40, 0.40)
WARM_UP_TICKS = 5
PARTICLE_STEPS = 1e9
"""Per repeat, unless that makes fewer than 100 steps or more than 1000: the plate stays off the far wall."""

PARTS = 20
"""Parts of a run whose means give the interval of its mean: Student's t is then 2.09, its limit 1.96."""

SPEED_M_PER_S = 0.5
"""Of the cycle scene."""

SLICE_RADII = 40
"""Width of the slice of the field that is prepared, in radii (chosen: minutes are saved)."""

MIXED_AND_FLOAT64 = ("mixed", "float64")


def main() -> int:
    """Runs what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=["throughput", "kernels", "exchange", "field", "peer", "scene"])
    parser.add_argument("scene", nargs="?")
    parser.add_argument("--counts", type=float, nargs="+", default=[1e4, 1e5, 1e6, 1e7, 3e7])
    parser.add_argument("--count", type=float, default=1e6)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--radii", type=float, nargs="+", default=[0.010, 0.005, 0.0025])
    parser.add_argument("--part", type=float, default=0.01, help="part of the metre that is run")
    parser.add_argument("--lammps", type=Path, help="built with KOKKOS for this GPU")
    parser.add_argument("--sides", type=int, nargs="+", default=[46, 100], help="spheres along an edge")
    parser.add_argument("--device", choices=["cpu", "gpu"], default="gpu")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument("--out", type=Path, default=OUT)
    args = parser.parse_args()
    set_up_numba()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if args.what == "throughput":
            rows = throughput(folder, [int(count) for count in args.counts], args.repeats)
        elif args.what == "kernels":
            rows = kernels(folder, int(args.count))
        elif args.what == "exchange":
            rows = exchange(folder, args.repeats)
        elif args.what == "field":
            rows = field(args.radii, args.part)
        elif args.what == "peer":
            rows = peer(folder, args.sides, args.lammps, args.repeats)
        else:
            rows = scene(Path(args.scene), args.device, args.threads, args.overrides)
        stem = args.what if args.what != "scene" else f"scene_{Path(args.scene).stem}_{args.device}"
        write(args.out / f"{stem}.csv", rows)
    return 0


def write(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Prints each row when it is there, and keeps what there is."""
    written: list[dict[str, Any]] = []
    for row in rows:
        written.append({**row, **provenance()})
        print(" ".join(f"{key} {_short(value)}" for key, value in row.items()), flush=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_rows(path, written)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def provenance() -> dict[str, str]:
    """What the figures were measured with."""
    from numba import cuda

    versions = {name: importlib.metadata.version(name) for name in ("numba", "numba-cuda") if _has(name)}
    return {
        "gpu": cuda.get_current_device().name if cuda.is_available() else "none",
        "cpu": machine_name(),
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
    }


def _has(name: str) -> bool:
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def dense_case(
    folder: Path, count: int, precision: str, soil_steps: int = STEPS_PER_TICK
) -> tuple[Case, Bed]:
    """A case of about `count` particles and its bed."""
    size = SMALL_BED_M if count < 50_000 else LARGE_BED_M
    case = cohesive_case(DENSE, size, 1, f"dense random {count:,}", folder, precision)
    case = periodic(case, size[1])
    one = _cell(case, size)
    times = max(1, round(count / len(one.positions_m)))
    return ticks_of(periodic(case, times * size[1]), soil_steps), repeated(one, times)


_cells: dict[tuple[float, ...], Bed] = {}


def _cell(case: Case, size: tuple[float, ...]) -> Bed:
    if size not in _cells:
        _cells[size] = prepare_dense(case.resolved, 0, 1, ignore_progress, device="gpu")
    return _cells[size]


def repeated(bed: Bed, times: int) -> Bed:
    """A periodic bed so many times side by side."""
    period = bed.period_m
    assert period is not None
    low = bed.lower_m[1] - 0.5 * (times - 1) * period
    shifts = low - bed.lower_m[1] + period * np.arange(times)
    n = len(bed.positions_m)
    positions = np.tile(bed.positions_m, (times, 1))
    positions[:, 1] += np.repeat(shifts, n)
    return dataclasses.replace(
        bed,
        positions_m=positions,
        lower_m=(bed.lower_m[0], low, bed.lower_m[2]),
        upper_m=(bed.upper_m[0], low + times * period),
    )


def started(case: Case, bed: Bed) -> SoilEngine:
    """The engine of a case before its first step."""
    engine = SoilEngine(on_gpu(case.resolved), bed)
    engine.start(case.motions(0))
    return engine


def throughput(folder: Path, counts: list[int], repeats: int) -> Iterable[dict[str, Any]]:
    """Particle-steps per second of wall time."""
    from numba import cuda

    for count in counts:
        for precision in MIXED_AND_FLOAT64:
            if precision == "float64" and count > 1.5e7:
                continue  # 30 million take 82 GB
            case, bed = dense_case(folder, count, precision)
            free = cuda.current_context().get_memory_info()[0]
            engine = started(case, bed)
            n, drive = engine.particle_count, Drive(engine, case)
            drive.run(WARM_UP_TICKS)
            ticks = round(min(max(PARTICLE_STEPS / n, 100.0), 1000.0) / STEPS_PER_TICK)
            rebuilds = engine.state("", 0, 0).rebuild_count
            walls = [drive.run(ticks) for _ in range(repeats)]
            state, steps = engine.state("", 0, 0), ticks * STEPS_PER_TICK
            rate = [n * steps / wall for wall in walls]
            yield {
                "particles": n,
                "precision": precision,
                "steps": steps,
                "repeats": repeats,
                "us_per_step": 1e6 * statistics.median(walls) / steps,
                "particle_steps_per_s": statistics.median(rate),
                "least": min(rate),
                "most": max(rate),
                "rebuilds_per_repeat": (state.rebuild_count - rebuilds) / repeats,
                "listed_pairs_per_particle": engine.listed_pair_count / n,
                "contacts_per_particle": state.contact_count / n,
                "bytes_per_particle": (free - cuda.current_context().get_memory_info()[0]) / n,
            }
            del engine, drive


def kernels(folder: Path, count: int) -> Iterable[dict[str, Any]]:
    """Wall time of each kernel of a step, and of new lists."""
    from subsoil_ros.dem.gpu.device import Launches

    for precision in MIXED_AND_FLOAT64:
        case, bed = dense_case(folder, count, precision)
        engine: Any = started(case, bed)
        for tick in range(WARM_UP_TICKS):
            engine.advance(tick, case.motions(tick + 1))
        device = engine._steps._device
        device.run_steps(1)
        here, other = (device._sides[k].launches for k in (device._at, 1 - device._at))
        one_by_one = {launch[0].py_func.__name__: [launch] for launch in here["step"]._launches}
        drift = one_by_one.pop("drift")  # last: after it kernels return until lists are new
        del one_by_one["end_step"]
        rebuilt = {f"new lists: {name}": other[name]._launches for name in ("sort", "lists", "fill")}
        parts = [*one_by_one.items(), ("drift", drift), *rebuilt.items()]
        for name, launches in parts:
            many = Launches(device.stream)
            repeats = 20 if not name.startswith("new") else 1
            for _ in range(repeats):
                for kernel, grid, threads, arguments in launches:
                    many.add(kernel, grid, *arguments, threads=threads)
            times = []
            for _ in range(6):
                device.stream.synchronize()
                start = time.perf_counter()
                many.run()
                device.stream.synchronize()
                times.append((time.perf_counter() - start) / repeats)
            yield {
                "particles": engine.particle_count,
                "precision": precision,
                "kernel": name,
                "us": 1e6 * statistics.median(times[2:]),
            }
        del engine, device


def exchange(folder: Path, repeats: int) -> Iterable[dict[str, Any]]:
    """Wall time of a tick of one soil step, and of ten."""
    for soil_steps in (1, STEPS_PER_TICK):
        case, bed = dense_case(folder, 1_000, "mixed", soil_steps)
        engine, ticks = started(case, bed), 1000 // soil_steps
        drive = Drive(engine, case)
        drive.run(ticks)
        walls = [drive.run(ticks) for _ in range(repeats)]
        yield {
            "particles": engine.particle_count,
            "soil_steps_per_tick": soil_steps,
            "us_per_tick": 1e6 * statistics.median(walls) / ticks,
        }


def field(radii: list[float], part: float) -> Iterable[dict[str, Any]]:
    """Wall time of a metre, from a part of it; the bed is prepared on the GPU."""
    for radius in radii:
        for precision in MIXED_AND_FLOAT64:
            overrides = [
                f"soil.particles.radius_m={radius!r}",
                f"soil.skin_m={0.3 * radius!r}",
                f"soil.precision={precision}",
                "soil.bin.length_m=2.0",
                "soil.bin.sides=periodic",
            ]
            resolved = load_scene(DENSE_BED, overrides)
            start = time.perf_counter()
            bed = _field_bed(resolved, radius)
            prepared = time.perf_counter() - start
            engine = SoilEngine(on_gpu(resolved), bed)
            mechanism = build_mechanism(resolved)
            assert mechanism is not None
            mounted, step_s = mechanism.initial_motions(), resolved.timing.soil_step_s
            whole = round(1.0 / SPEED_M_PER_S / step_s)
            engine.start(_moved(mounted, 0, step_s))
            steps = max(200, round(part * whole))
            for step in range(100):
                engine.advance(step, _moved(mounted, step + 1, step_s))
            start = time.perf_counter()
            for step in range(100, 100 + steps):
                engine.advance(step, _moved(mounted, step + 1, step_s))
            wall = time.perf_counter() - start
            yield {
                "radius_m": radius,
                "precision": precision,
                "particles": engine.particle_count,
                "step_s": step_s,
                "steps_per_metre": whole,
                "steps_run": steps,
                "particle_steps_per_s": engine.particle_count * steps / wall,
                "s_per_metre": wall * whole / steps,
                "s_to_prepare_bed": prepared,
            }
            del engine


def _moved(mounted: tuple[ToolMotion, ...], step: int, step_s: float) -> tuple[ToolMotion, ...]:
    """Tools that start in the soil and drive on without turning."""
    way = 0.6 + SPEED_M_PER_S * step * step_s
    return tuple(
        dataclasses.replace(motion, x_m=motion.x_m + way, velocity_x_m_per_s=SPEED_M_PER_S)
        for motion in mounted
    )


_field_beds: dict[float, Bed] = {}


def _field_bed(resolved: ResolvedScene, radius: float) -> Bed:
    """A slice between periodic sides, repeated to the width of the bin."""
    if radius not in _field_beds:
        soil = resolved.scene.particle_soil
        assert soil is not None
        times = max(1, round(soil.bin.width_m / (SLICE_RADII * radius)))
        narrow = soil.bin.model_copy(update={"width_m": soil.bin.width_m / times})
        scene = resolved.scene.model_copy(update={"soil": soil.model_copy(update={"bin": narrow})})
        slice_of_it = dataclasses.replace(resolved, scene=scene)
        _field_beds[radius] = repeated(prepare_dense(slice_of_it, 0, 1, ignore_progress, device="gpu"), times)
    return _field_beds[radius]


def scene(path: Path, device: str, threads: int, overrides: list[str]) -> Iterable[dict[str, Any]]:
    """A whole run, direct mode."""
    resolved = load_scene(path, [f"soil.device={device}", *overrides])
    done = execute(resolved, threads, warm_up=True)
    if done.facts["failure"] is not None:
        sys.exit(done.facts["failure"])
    with tempfile.TemporaryDirectory() as name:
        table = Path(name) / "series.csv"
        table.write_bytes(done.files["series.csv"])
        with table.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    half = rows[len(rows) // 2 :]
    means: dict[str, float] = {}
    for column in rows[0]:
        if not (column == "draft_newton" or column.endswith(("force_z_newton", "torque_y_newton_m"))):
            continue
        values = np.array([float(row[column]) for row in half])
        interval = mean_interval([float(part.mean()) for part in np.array_split(values, PARTS)])
        means[column], means[f"{column} +-"] = interval.mean, interval.half_width
    yield {
        "scene": path.stem,
        "device": device,
        "precision": resolved.scene.particle_soil.precision if resolved.scene.particle_soil else "",
        "ticks": resolved.timing.tick_count,
        "simulated_s": resolved.timing.tick_count * resolved.timing.communication_step_s,
        "wall_s": done.facts["wall_s"],
        **{key: value for key, value in means.items() if math.isfinite(value)},
    }


if __name__ == "__main__":
    sys.exit(main())
