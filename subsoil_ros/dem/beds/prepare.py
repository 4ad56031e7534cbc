"""Preparation of the bed that a scene describes."""

import math
from pathlib import Path

import numpy as np

from ...errors import SceneError
from ...loading.loader import ResolvedScene
from ...rotations import placed_m
from ...scene.bed_spacing import particle_spacing_m, rest_spacing_m
from ...scene.beds import GridBed, SavedBed, TiledBed
from ...scene.meshes import load_tool_mesh
from ...scene.pairs import pair_values
from ...scene.soil import Soil
from ..bed import Bed, grid_shape, prepare_grid, refuse_too_many
from ..periodic import HELD_LAYER, refuse_narrow_period, refuse_tool_at_held_side, refuse_tool_at_seam
from .bed_file import LARGEST_OVERLAP, read_bed
from .cache import cached_bed_path, keep, load_cached
from .dense import prepare_dense, rest_volume_m3
from .field import Field, kept_block
from .settling import EngineOf, OnProgress, ignore_progress
from .surface import profile_m
from .tile import tile_edge_m
from .tiled import prepare_tiled


def prepare_bed(
    resolved: ResolvedScene, engine_of: EngineOf, threads: int = 1, on_progress: OnProgress = ignore_progress
) -> Bed:
    """The bed of the scene's soil, or the first window of its field; `engine_of` is the class SoilEngine,
    which settles particles.

    A bed that takes long to prepare is kept in the user's cache folder and taken from there the next time;
    `on_progress` receives the progress of its preparation.

    Raises:
        SceneError: a bin too small for a particle, particles that overlap too far, an unfit bed file.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None
    if isinstance(soil.bed, GridBed):
        _refuse_tight_grid(soil)
        bed = prepare_grid(soil, resolved.scene.gravity_m_per_s2)
        refuse_narrow_period(bed, soil)
        return bed
    if isinstance(soil.bed, SavedBed):
        return read_bed(Path(soil.bed.file), soil)
    if soil.window is not None:
        field = Field(kept_block(resolved, engine_of, threads, on_progress), soil)
        return field.bed(*field.first_window)
    refuse_narrow_period(nominal_box(soil), soil)
    path = cached_bed_path(resolved)
    kept = load_cached(path, soil)
    if kept is None and isinstance(soil.bed, TiledBed):
        kept = prepare_tiled(resolved, engine_of, threads, on_progress)
        keep(path, kept, soil)
    elif kept is None:
        kept = prepare_dense(resolved, soil.bed.seed, engine_of, threads, on_progress)
        keep(path, kept, soil)
    return kept


def nominal_box(soil: Soil) -> Bed:
    """The scene's bin without particles."""
    half_width = 0.5 * soil.bin.width_m
    lower = (0.0, -half_width, -soil.bin.depth_m)
    return Bed(np.empty((0, 3)), lower, (soil.bin.length_m, half_width), sides=soil.bin.bed_sides)


def _refuse_tight_grid(soil: Soil) -> None:
    smallest = rest_spacing_m(soil) - LARGEST_OVERLAP * soil.particles.mean_volume_radius_m
    given = particle_spacing_m(soil)
    if given < smallest:
        raise SceneError(
            f"soil.bed.spacing_m: {given:g} m makes neighbours overlap so far that they would be shot apart; "
            f"allowed is at least {smallest:.4g} m; with 'rest' the bed stands still"
        )
    assert isinstance(soil.bed, GridBed)
    to_wall = soil.particles.mean_volume_radius_m - pair_values(soil)[1].rest_overlap
    largest = min(0.5 * (given - smallest), to_wall)
    if soil.bed.jitter_m > largest:
        raise SceneError(
            f"soil.bed.jitter_m: {soil.bed.jitter_m:g} m may press neighbours into each other so far that "
            f"they would be shot apart, or a centre into a wall; allowed is at most {largest:.4g} m here"
        )


DENSE_FRACTION = 0.69
"""Volume of spheres of the rest distance in a dense random bed under the cohesive linear law, over that of
the bed (measured: 0.684 with 2,000 particles, 0.696 with 9,000)."""


def check_start(resolved: ResolvedScene) -> int:
    """Check what a run would start from, without preparing it.

    Returns the number of particles before tools remove any: estimated for random beds, else exact.

    Raises:
        SceneError: a fault that would stop the preparation, or a tool too near periodic or held sides.
    """
    soil = resolved.scene.particle_soil
    if soil is None:
        return 0
    if isinstance(soil.bed, GridBed):
        _refuse_tight_grid(soil)
        box = prepare_grid(soil, resolved.scene.gravity_m_per_s2)
    elif isinstance(soil.bed, SavedBed):
        box = read_bed(Path(soil.bed.file), soil)
    else:
        grid_shape(soil)  # refuses a bin too small for a particle
        box = nominal_box(soil)
    if isinstance(soil.bed, TiledBed):
        tile_edge_m(soil)
    refuse_narrow_period(box, soil)
    ends = []
    for name, tool in resolved.scene.tools.items():
        mesh = load_tool_mesh(resolved.directory, resolved.scene, name)
        vertices, path = mesh.vertices_m, tool.path
        if path is not None and path.is_spatial:
            start = path.start_m(tool.lateral_m)
            vertices = placed_m(mesh.about_body().vertices_m, start, path.start_quaternion)
        refuse_tool_at_seam(name, vertices, box, soil)
        refuse_tool_at_held_side(name, vertices, soil)
        ends.append((float(vertices[:, 0].min()), float(vertices[:, 0].max())))
    tools_m = max((high for _, high in ends), default=0.0) - min((low for low, _ in ends), default=0.0)
    count = len(box.positions_m) or expected_dense_count(soil, tools_m)
    refuse_too_many(count, soil)
    return count


def expected_dense_count(soil: Soil, tools_m: float = 0.0) -> int:
    """Particles of a random bed before tools remove any, within 2 % (several sizes: 5 %, tiled: 15 %); in a
    window, about tools of this length."""
    length = soil.bin.length_m
    if soil.window is not None:
        length = min(length, soil.window.ahead_m + tools_m + soil.window.behind_m)
    x = np.linspace(0.0, soil.bin.length_m, 1001)
    depth = soil.bin.depth_m + float(profile_m(soil.surface, x).mean())
    volume = length * soil.bin.width_m * depth
    if isinstance(soil.bed, TiledBed):
        held = HELD_LAYER * soil.particles.bounds_m[1] if soil.bed.floor == "held" else 0.0
        volume += length * soil.bin.width_m * held
        sphere = 4.0 / 3.0 * math.pi * soil.particles.mean_volume_radius_m**3
        return round(soil.bed.solid_fraction * volume / sphere)
    return round(DENSE_FRACTION * volume / rest_volume_m3(soil))
