"""What `subsoil check` says of the soil and its bed. Code of particles is imported only for them."""

import math
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from ...errors import InputError
from ...loading.loader import ResolvedScene
from ...loading.soil_file import soil_of
from ...scene.bed_kinds import GridBed, SavedBed, TiledBed
from ...scene.material import Material
from ...scene.pair_laws import layer_soils, particle_spacing_m
from ...scene.soil import Soil, SoilWindow, rupture_distance_m
from ...scene.terrain_soil import TerrainSoil
from ...scene.tool_faces import cutting_faces, wheel_face
from ...scene.tool_mesh import load_tool_mesh
from ...scene.wedge_soil import WedgeSoil
from ..output import table

if TYPE_CHECKING:
    from ...dem.free_motion import FreeMotion
    from ...dem.packing.bed_report import BedReport


def material_rows(material: Material) -> Iterable[tuple[str, str]]:
    """Rows of the laboratory's values and those of the particles, with 95 % intervals."""
    asked = material.soil.model_dump()
    yield "soil", material.soil.name
    for key, found in material.measured.items():
        wanted = f"{asked[key]:g}, found " if asked.get(key) is not None else ""
        half = 0.5 * (found.high - found.low)
        yield key, f"{wanted}{found.value:.4g} +- {half:.2g}"


def wedge_rows(resolved: ResolvedScene, soil: WedgeSoil) -> Iterable[tuple[str, str]]:
    """Rows of the values of a wedge model, and of each tool's face or wheel."""
    found = soil_of(soil)
    values = found.values
    phi, delta = math.degrees(values.friction_angle_rad), math.degrees(values.tool_friction_angle_rad)
    yield "from", "the scene" if soil.file is None else soil.file
    if found.fitted_range is not None:
        fitted = found.fitted_range
        low, high = (math.degrees(rake) for rake in fitted.rake_rad)
        yield (
            "fitted for",
            f"depth {fitted.depth_m[0]:g} to {fitted.depth_m[1]:g} m, rake {low:.0f} to {high:.0f} deg, "
            f"speed {fitted.speed_m_per_s[0]:g} to {fitted.speed_m_per_s[1]:g} m/s",
        )
    yield (
        "strength",
        f"c = {values.cohesion_pa:.4g} Pa, phi = {phi:.3g} deg; tools: c_a = {values.adhesion_pa:.4g} Pa,"
        f" delta = {delta:.3g} deg",
    )
    period = f"{values.period_factor:.3g} wedge lengths"
    if values.period_m is not None:
        period = f"{1e3 * values.period_m:.3g} mm"
    yield "density", f"{values.density_kg_per_m3:.4g} kg/m3"
    yield (
        "failure",
        (f"drop {values.drop:.3g}, period {period}, variation {values.variation:.3g}, seed {soil.seed}"),
    )
    for name, tool in resolved.scene.tools.items():
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
        if not tool.is_tillage:
            wheel = wheel_face(mesh, f"tools.{name}")
            yield f"wheel {name}", f"radius {wheel.radius_m:.4g} m, width {wheel.width_m:.4g} m"
            continue
        for face in cutting_faces(mesh, f"tools.{name}"):
            what = "share" if face.is_share else "shank"
            yield (
                f"{what} {name}.{mesh.groups[face.group]}",
                f"width {face.width_m:.4g} m, rake {math.degrees(face.rake_rad):.1f} degrees",
            )


def terrain_rows(resolved: ResolvedScene, soil: TerrainSoil) -> Iterable[tuple[str, str]]:
    """Rows of the strength of a terrain, and of what each tool holds."""
    from ...terrain.tool_shape import held_m3, views

    values = soil.values
    for name, cohesion, friction in (
        ("firm", values.cohesion_pa, values.friction_angle_rad),
        ("loose", values.loose_cohesion_pa, values.loose_friction_angle_rad),
    ):
        yield name, f"c = {cohesion:.4g} Pa, phi = {math.degrees(friction):.3g} deg"
    delta = math.degrees(values.tool_friction_angle_rad)
    yield "on tools", f"c_a = {values.adhesion_pa:.4g} Pa, delta = {delta:.3g} deg"
    yield "density", f"{values.density_kg_per_m3:.4g} kg/m3, loosened by {100.0 * values.loosening:.3g} %"
    rows, columns = soil.shape
    yield "cells", f"{rows} x {columns} of {1e3 * soil.cell_m:g} mm"
    for name in resolved.scene.tools:
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name).about_body()
        held = max((held_m3(view, soil.cell_m) for view in views(mesh, soil.cell_m)), default=0.0)
        yield f"tool {name}", f"holds {1e3 * held:.3g} l, level" if held > 0.0 else "holds no soil"


def particle_rows(resolved: ResolvedScene, soil: Soil, count: int) -> Iterable[tuple[str, str]]:
    """Particles, layers, bed and bin of a soil of particles."""
    from ...dem.packing.bed_file import bed_path
    from ...dem.packing.grid import grid_shape, prepare_grid

    spheres = f"of radius {soil.particles.radius_words()}"
    if not isinstance(soil.bed, GridBed):
        about = "" if isinstance(soil.bed, SavedBed) else "about "
        yield "particles", f"{about}{count:,} {spheres}, less those that tools overlap"
        yield from _layer_rows(soil)
        if isinstance(soil.bed, SavedBed):
            yield "bed", f"from {soil.bed.file}"
        else:
            kept = bed_path(resolved)
            when = f"kept in {kept}" if kept.is_file() else "prepared when it is first used, in minutes"
            yield "bed", f"{_random_bed(soil)}, seed {soil.bed.seed}; {when}"
        size = soil.bin
        fitted = "walls" if size.sides == "walls" else "ends and period in y"
        if isinstance(soil.bed, TiledBed):
            kind = "walls" if size.sides == "walls" else f"{size.sides} sides"
            fitted = f"{kind}, {soil.bed.floor} floor"
        else:
            fitted += " fitted to the bed"
        box = "bin" if soil.window is None else "field"
        yield box, f"{size.length_m:g} x {size.width_m:g} x {size.depth_m:g} m, {fitted}"
        if soil.moving_window is not None:
            yield "window", _window(resolved, soil, soil.moving_window)
        return
    nx, ny, nz = grid_shape(soil)
    bed = prepare_grid(soil, resolved.scene.gravity_m_per_s2)
    yield "particles", f"{count:,} {spheres}, less those that tools overlap"
    yield from _layer_rows(soil)
    spacing_mm = particle_spacing_m(soil) * 1e3
    yield "bed", f"{nz} layers of {nx} x {ny}, spacing {spacing_mm:g} mm, top at z = 0"
    length, width = bed.upper_m[0] - bed.lower_m[0], bed.upper_m[1] - bed.lower_m[1]
    yield (
        "bin",
        f"{soil.bin.length_m:g} x {soil.bin.width_m:g} x {soil.bin.depth_m:g} m; fitted to the bed: "
        f"{length:.4g} x {width:.4g} m, floor at z = {bed.lower_m[2]:.4f} m"
        + ("" if bed.period_m is None else f", y periodic with {width:.4g} m"),
    )


def _window(resolved: ResolvedScene, soil: Soil, window: SoilWindow) -> str:
    text = f"soil exists from {window.behind_m:g} m behind the tools to {window.ahead_m:g} m ahead of them"
    if resolved.material is None:
        return text
    angle = resolved.material.soil.friction_angle_deg
    rupture = rupture_distance_m(soil.bin.depth_m, angle)
    return f"{text}; a cut as deep as the bed fails {rupture:.3g} m ahead at {angle:g} degrees"


def _random_bed(soil: Soil) -> str:
    heights = () if soil.surface is None else sorted({min(soil.surface.z_m), max(soil.surface.z_m)})
    surface = "" if not heights else f", surface at z = {' to '.join(f'{z:g}' for z in heights)} m"
    if not isinstance(soil.bed, TiledBed):
        return f"dense random{surface}"
    from ...dem.packing.bed_geometry import sample_edge_m

    density = soil.bed.solid_fraction * soil.particles.density_kg_per_m3
    return (
        f"tiled, solid fraction {soil.bed.solid_fraction:g} ({density:.0f} kg/m3), "
        f"tiles of {sample_edge_m(soil):.3g} m{surface}"
    )


def _layer_rows(soil: Soil) -> Iterable[tuple[str, str]]:
    above = 0.0
    for layer, whole in zip(soil.layers or (), layer_soils(soil), strict=False):
        bottom = "the floor" if layer.thickness_m is None else f"{above + layer.thickness_m:g} m"
        density = whole.particles.density_kg_per_m3
        own = "" if layer.law is None else ", with a law of its own"
        yield f"layer {layer.name}", f"{above:g} m down to {bottom}, particles of {density:g} kg/m3{own}"
        above += layer.thickness_m or 0.0


LEFT_ALONE_S = 0.02
"""Time that the bed runs without tools: long enough for waves to cross some 0.3 m of it."""


def print_bed(console: Console, resolved: ResolvedScene, threads: int, out: Path | None) -> None:
    """Prepare the bed of a scene, print its report, and write it to `out` where given."""
    from ...api.prepare_bed import prepare_bed_first
    from ...dem.build import build_engine
    from ...dem.free_motion import free_motion
    from ...dem.packing.bed_file import write_bed
    from ...dem.packing.bed_report import report_bed
    from ..progress import KernelAnnouncer, bed_progress, working

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
    for name, text in _bed_rows(looked, motion):
        found.add_row(name, text)
    if out is not None:
        found.add_row("written to", str(out))
    console.print(found)


def _bed_rows(report: "BedReport", motion: "FreeMotion") -> Iterable[tuple[str, str]]:
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
