"""The simplest bed: a cubic grid that stands still from the first step."""

import numpy as np

from ...contact_laws.base import PairValues
from ...errors import SceneError
from ...scene.bed_kinds import GridBed
from ...scene.pair_laws import (
    boundary_values,
    layer_soils,
    pair_values,
    particle_spacing_m,
    particle_values,
    rest_spacing_m,
    sphere_mass_kg,
)
from ...scene.soil import Soil
from ..bed import Bed
from ..mixture import material_at
from .bed_geometry import LARGEST_OVERLAP

LARGEST_COUNT = 100_000_000
"""Largest number of particles in a bed: so many take some 60 GB of memory."""


def grid_shape(soil: Soil) -> tuple[int, int, int]:
    """Particles along x, y and z that the bin holds at the bed's spacing.

    Raises:
        SceneError: the bin holds none.
    """
    radius, spacing = soil.particles.mean_volume_radius_m, particle_spacing_m(soil)
    _, boundary = pair_values(soil)
    wall = radius - boundary.rest_overlap  # centre to wall, unloaded

    def count(extent: float, free: float) -> int:
        return int(np.floor((extent - free) / spacing + 1e-9)) + 1 if extent >= free else 0

    between_sides = spacing if soil.bin.sides == "periodic" else 2.0 * wall  # as far as from one to the next
    shape = (
        count(soil.bin.length_m, 2.0 * wall),
        count(soil.bin.width_m, between_sides),
        count(soil.bin.depth_m, wall + radius),
    )
    if min(shape) < 1:
        raise SceneError(
            f"soil.bin: {soil.bin.length_m:g} x {soil.bin.width_m:g} x {soil.bin.depth_m:g} m holds no "
            f"particle of radius {radius:g} m; make every side larger than {2 * radius:g} m"
        )
    return shape


def refuse_too_many(count: int, soil: Soil) -> None:
    """Raise SceneError if a bed of `count` particles is larger than LARGEST_COUNT."""
    if count > LARGEST_COUNT:
        raise SceneError(
            f"soil.bin: a bed of {soil.bin.length_m:g} x {soil.bin.width_m:g} x {soil.bin.depth_m:g} m would "
            f"hold {count:.3g} particles of radius {soil.particles.mean_volume_radius_m:g} m, allowed are "
            f"{LARGEST_COUNT:,}; make it smaller, or the particles larger"
        )


def _layers(soil: Soil, x_m: np.ndarray, layers: int, spacing_m: float) -> list[int]:
    """Layers of the grid that stand below the surface profile, at least one, in each slice of `x_m`."""
    if soil.surface is None:
        return [layers] * len(x_m)
    taken = np.ceil(-np.interp(x_m, soil.surface.x_m, soil.surface.z_m) / spacing_m - 1e-9).astype(np.int64)
    return np.maximum(layers - taken, 1).tolist()


def prepare_grid(soil: Soil, gravity_m_per_s2: float) -> Bed:
    """Cubic grid of equal spheres at the given spacing, walls moved in to fit it.

    A row of n spheres touches both walls at the unloaded overlap, so a wall stands up to one spacing
    inside the bin's nominal size. At the stress-free spacing 2 r - delta_c the layers are lowered by what
    the weight above presses them together (n m g / K_X under n layers), and the bed is in equilibrium.
    Where a surface profile takes layers away, those below carry that much less. Between periodic sides the
    bed is a whole number of spacings wide.

    The depth of a particle's centre in the unloaded grid sets its layer of the soil.
    """
    materials = layer_soils(soil)
    boundary = pair_values(soil)[1]
    radius, spacing = soil.particles.mean_volume_radius_m, particle_spacing_m(soil)
    nx, ny, nz = grid_shape(soil)
    refuse_too_many(nx * ny * nz, soil)
    wall = radius - boundary.rest_overlap
    weights = np.array([sphere_mass_kg(material, radius) * gravity_m_per_s2 for material in materials])
    material = material_at(soil, radius + spacing * np.arange(nz))[::-1]  # of the grid's layers, from below

    def between(lower: int, upper: int) -> PairValues:
        first, second = materials[material[lower]], materials[material[upper]]
        masses = sphere_mass_kg(first, radius), sphere_mass_kg(second, radius)
        return particle_values(first, second, 0.5 * radius, masses[0] * masses[1] / sum(masses))

    def weight_on(layer: int, layers: int) -> float:
        """Weight of the grid layers layer <= k < layers, one particle each [N]."""
        return float(np.bincount(material[layer:layers], minlength=len(weights)) @ weights)

    def column(layers: int) -> np.ndarray:
        """Heights over the floor of the centres of `layers` layers on top of each other [m]."""
        steps_up = np.full(layers - 1, spacing)
        for k in range(layers - 1):
            pair = between(k, k + 1)
            if spacing <= 2.0 * radius - pair.rest_overlap + 1e-12:
                steps_up[k] -= pair.loaded_m(weight_on(k + 1, layers))
        lowest = materials[material[0]]
        at_floor = boundary_values(lowest, radius, sphere_mass_kg(lowest, radius))
        return wall - at_floor.loaded_m(weight_on(0, layers)) + np.concatenate(([0.0], np.cumsum(steps_up)))

    x = wall + spacing * np.arange(nx)
    heights = _layers(soil, x, nz, spacing)
    columns = {layers: column(layers) for layers in {nz, *heights}}
    floor = -float(columns[nz][-1]) - radius  # top of the uppermost spheres at z = 0
    y = spacing * (np.arange(ny) - 0.5 * (ny - 1))
    slices = [
        np.stack(np.meshgrid([x[i]], y, floor + columns[layers], indexing="ij"), axis=-1).reshape(-1, 3)
        for i, layers in enumerate(heights)
    ]
    _refuse_too_soft(soil, columns[nz])
    grid = np.concatenate(slices)
    if isinstance(soil.bed, GridBed) and soil.bed.jitter_m > 0.0:
        generator = np.random.default_rng(soil.bed.seed)
        grid = grid + generator.uniform(-soil.bed.jitter_m, soil.bed.jitter_m, grid.shape)
    half_width = 0.5 * spacing * (ny - 1) + (0.5 * spacing if soil.bin.sides == "periodic" else wall)
    return Bed(
        positions_m=np.ascontiguousarray(grid),
        lower_m=(0.0, -half_width, floor),
        upper_m=(float(x[-1] + wall), half_width),
        materials=np.concatenate([np.tile(material[:n], ny) for n in heights]) if soil.layers else None,
        sides=soil.bin.bed_sides,
    )


def _refuse_too_soft(soil: Soil, heights_m: np.ndarray) -> None:
    """Raise SceneError if the weight presses layers at `heights_m` (n,) so close that particles reach others
    than their six neighbours: those of the layer after the next, or across a diagonal."""
    reach = 2.0 * soil.particles.mean_volume_radius_m + pair_values(soil)[0].reach
    diagonal = float(np.sqrt(max(0.0, reach**2 - particle_spacing_m(soil) ** 2)))
    nearest = max(0.5 * reach, diagonal)
    closest = float(np.diff(heights_m).min(initial=np.inf))
    if closest <= nearest < particle_spacing_m(soil):  # a closer spacing is the scene's own choice
        raise SceneError(
            f"soil.law: too soft for a bed of {len(heights_m)} layers: their weight presses the lowest to "
            f"{closest:.3g} m of each other, allowed is more than {nearest:.3g} m; make soil.law.particle "
            "stiffer, or the bed lighter or less deep"
        )


def refuse_tight_grid(soil: Soil) -> None:
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
