"""What a run would start from, without preparing its bed."""

import math
from pathlib import Path

import numpy as np

from ...loading.loader import ResolvedScene
from ...rotations import placed_m
from ...scene.bed_kinds import GridBed, SavedBed, TiledBed
from ...scene.pair_laws import rest_spacing_m
from ...scene.sizes import mean_power
from ...scene.soil import Soil
from ...scene.tool_mesh import load_tool_mesh
from ..bed import Bed, profile_m
from ..periodic import HELD_LAYER, refuse_narrow_period, refuse_tool_at_held_side, refuse_tool_at_seam
from .bed_file import read_bed
from .bed_geometry import sample_edge_m
from .grid import grid_shape, prepare_grid, refuse_tight_grid, refuse_too_many


def nominal_box(soil: Soil) -> Bed:
    """The scene's bin without particles."""
    half_width = 0.5 * soil.bin.width_m
    lower = (0.0, -half_width, -soil.bin.depth_m)
    return Bed(np.empty((0, 3)), lower, (soil.bin.length_m, half_width), sides=soil.bin.bed_sides)


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
        refuse_tight_grid(soil)
        box = prepare_grid(soil, resolved.scene.gravity_m_per_s2)
    elif isinstance(soil.bed, SavedBed):
        box = read_bed(Path(soil.bed.file), soil)
    else:
        grid_shape(soil)  # refuses a bin too small for a particle
        box = nominal_box(soil)
    if isinstance(soil.bed, TiledBed):
        sample_edge_m(soil)
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
    if (window := soil.moving_window) is not None:
        length = min(length, window.ahead_m + tools_m + window.behind_m)
    x = np.linspace(0.0, soil.bin.length_m, 1001)
    depth = soil.bin.depth_m + float(profile_m(soil.surface, x).mean())
    volume = length * soil.bin.width_m * depth
    if isinstance(soil.bed, TiledBed):
        held = HELD_LAYER * soil.particles.bounds_m[1] if soil.bed.floor == "held" else 0.0
        volume += length * soil.bin.width_m * held
        sphere = 4.0 / 3.0 * math.pi * soil.particles.mean_volume_radius_m**3
        return round(soil.bed.solid_fraction * volume / sphere)
    return round(DENSE_FRACTION * volume / rest_volume_m3(soil))


def rest_volume_m3(soil: Soil) -> float:
    """Mean volume of spheres as thick as their rest distance, 2 r - delta_c."""
    sizes, rest = soil.particles.sizes, rest_spacing_m(soil)
    if sizes is None:
        return math.pi / 6.0 * rest**3
    half_overlap = soil.particles.mean_volume_radius_m - 0.5 * rest
    return math.pi * 4.0 / 3.0 * mean_power(sizes, 3, less_m=half_overlap)
