"""The part of `subsoil check` that prepares a bed and prints its properties."""

import math
import time
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console

from ...api.prepare_bed import prepare_bed_first
from ...dem.build import build_engine
from ...dem.free_motion import FreeMotion, free_motion
from ...dem.packing.bed_file import write_bed
from ...dem.packing.bed_report import BedReport, report_bed
from ...errors import InputError
from ...loading.loader import ResolvedScene
from .._shared.output import table
from .._shared.progress import KernelAnnouncer, bed_progress, working

LEFT_ALONE_S = 0.02
"""Time that the bed runs without tools: long enough for waves to cross some 0.3 m of it."""


def print_bed(console: Console, resolved: ResolvedScene, threads: int, out: Path | None) -> None:
    """Prepare the bed of a scene, print its report, and write it to `out` where given."""
    soil = resolved.scene.particle_soil
    if soil is None:
        raise InputError(f"{resolved.path}: has no 'soil', so there is no bed to look at; leave out --bed")
    started = time.perf_counter()
    with KernelAnnouncer():
        prepare_bed_first(resolved, threads, bed_progress)
        bed = build_engine(resolved, threads).bed  # refuses a step too large for it
    seconds = time.perf_counter() - started
    if out is not None:
        try:
            write_bed(out, bed, soil)
        except OSError as error:
            raise InputError(f"--bed-out: {out}: cannot be written ({error.strerror})") from error
    with working("looking at the bed"):
        looked = report_bed(bed, soil)
    with working("leaving the bed alone"):
        motion = free_motion(resolved, bed, threads, LEFT_ALONE_S)
    found = table("bed")
    found.add_row("prepared in", f"{seconds:.1f} s")
    if bed.period_m is not None:
        found.add_row("period", f"{bed.period_m:.5g} m in y")
    for name, text in _rows(looked, motion):
        found.add_row(name, text)
    if out is not None:
        found.add_row("written to", str(out))
    console.print(found)


def _rows(report: BedReport, motion: FreeMotion) -> Iterable[tuple[str, str]]:
    yield "particles", f"{report.particle_count:,}"
    if report.radii is not None:
        radii = report.radii
        yield (
            "radii",
            f"{_mm(radii.min_m)} to {_mm(radii.max_m)}, mean {_mm(radii.mean_m)}, "
            f"standard deviation {_mm(radii.deviation_m)}",
        )
    for layer in report.layers:
        yield (
            layer.name,
            f"{layer.particle_count:,} particles, density {layer.density_kg_per_m3:.4g} kg/m3",
        )
    inside = report.density_inside_kg_per_m3
    apart = "" if math.isnan(inside) else f", {inside:.4g} away from walls, floor and top"
    yield "density", f"{report.density_kg_per_m3:.4g} kg/m3{apart}"
    yield "coordination", f"{report.coordination:.2f} particles in reach, mean"
    yield "stable step", f"{report.stable_step_s * 1e6:.4g} us at this coordination"
    yield "largest overlap", f"{_mm(report.max_overlap_m)} beyond rest"
    yield "top", f"mean z = {_mm(report.top_mean_m)}, spread {_mm(report.top_spread_m)}"
    yield "floor", f"z = {_mm(report.floor_m)}"
    for wall, gap in report.wall_gaps.items():
        yield (
            "gap at floor" if wall == "floor" else f"gap at {wall} wall",
            f"mean {_mm(gap.mean_m)}, largest {_mm(gap.max_m)} (negative: overlap)",
        )
    x, y, z = report.max_void_at_m
    radius = _mm(report.max_void_radius_m)
    yield "largest void", f"sphere of radius {radius} at ({x:.3f}, {y:.3f}, {z:.3f}) m"
    yield "kinetic energy", f"{report.kinetic_energy_joule:.2g} J left when its preparation ended"
    yield (
        f"alone for {motion.duration_s * 1e3:.3g} ms",
        f"kinetic energy {motion.kinetic_energy_joule:.2g} J, moves {motion.rms_move_m * 1e6:.3g} um, "
        f"{motion.max_move_m * 1e6:.3g} um at most (rms, largest)",
    )


def _mm(length_m: float) -> str:
    return f"{length_m * 1e3:.2f} mm"
