"""A prepared bed, and the simplest one: a cubic grid that stands still from the first step."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..contact_laws.base import PairValues
from ..errors import InputError, SceneError
from ..scene.bed_kinds import GridBed, SurfaceProfile
from ..scene.pair_laws import (
    boundary_values,
    layer_soils,
    pair_values,
    particle_spacing_m,
    particle_values,
    sphere_mass_kg,
)
from ..scene.soil import Soil
from .mixture import material_at

LARGEST_COUNT = 100_000_000
"""Largest number of particles in a bed: so many take some 60 GB of memory."""


@dataclass(frozen=True)
class Bed:
    """Prepared particles and the box they stand in. World axes, z = 0 at the mean top."""

    positions_m: np.ndarray  # (n, 3) float64
    lower_m: tuple[float, float, float]  # x, y, z of the walls x = 0, right side, floor
    upper_m: tuple[float, float]  # x, y of the far wall and the left side; the top is open
    kinetic_energy_joule: float = 0.0  # left when its preparation ended; a run starts from rest
    radii_m: np.ndarray | None = None  # (n,) float64; None: all are equal
    materials: np.ndarray | None = None  # (n,) int64 number of the layer from the top; None: there are none
    sides: Literal["walls", "periodic", "endless"] = "walls"
    """periodic: the box is one period wide in y; endless: it repeats itself along all axes, z = 0 its top."""
    held: np.ndarray | None = None  # (n,) bool: stays where it is; None: no particle does

    @property
    def period_m(self) -> float | None:
        """Period in y [m], None between walls."""
        return None if self.sides == "walls" else self.upper_m[1] - self.lower_m[1]

    @property
    def periods_m(self) -> tuple[float, float, float]:
        """Period along x, y and z [m], infinite where there is none."""
        x, y, z = self.lower_m
        if self.sides == "endless":
            return self.upper_m[0] - x, self.upper_m[1] - y, -z
        return np.inf, self.period_m or np.inf, np.inf

    @property
    def floor_m(self) -> float:
        """Lower end of the bed [m]: the plane of the floor, or the highest centre that is held."""
        return self.lower_m[2] if self.held is None else float(self.positions_m[self.held, 2].max())

    def only(self, kept: np.ndarray) -> "Bed":
        """The bed with only the particles `kept`: (n,) bool, or an array of their numbers."""
        return dataclasses.replace(
            self,
            positions_m=self.positions_m[kept],
            radii_m=None if self.radii_m is None else self.radii_m[kept],
            materials=None if self.materials is None else self.materials[kept],
            held=None if self.held is None else self.held[kept],
        )


def scaled(bed: Bed, scale: float | np.ndarray) -> Bed:
    """Bed and walls `scale` times as large, or (3,) along x, y and z, about the origin."""
    scales = np.broadcast_to(scale, 3)
    x, y, z = np.array(bed.lower_m) * scales
    far, left = np.array(bed.upper_m) * scales[:2]
    return dataclasses.replace(
        bed,
        positions_m=bed.positions_m * scale,
        lower_m=(float(x), float(y), float(z)),
        upper_m=(float(far), float(left)),
        kinetic_energy_joule=0.0,
    )


def radii_of(bed: Bed, soil: Soil) -> np.ndarray:
    """(n,) [m] radius of every particle."""
    if bed.radii_m is not None:
        return bed.radii_m
    return np.full(len(bed.positions_m), soil.particles.mean_volume_radius_m)


def profile_m(surface: SurfaceProfile | None, x_m: np.ndarray) -> np.ndarray:
    """Height of a surface profile at `x_m`; zero without one [m]."""
    return np.zeros_like(x_m) if surface is None else np.interp(x_m, surface.x_m, surface.z_m)


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


def refuse_outside(bed: Bed, planes: np.ndarray, position_m: np.ndarray) -> None:
    """Check that `position_m` (n, 3) is in the box of `bed`, open at the top and at periodic sides.

    Raises:
        InputError: a centre is outside or not a number, or no centre is given.
    """
    inside = (planes[:, 3] - position_m @ planes[:, :3].T >= 0.0).all(axis=1)  # not a number: outside
    if len(position_m) == 0 or not inside.all():
        given = "no particle" if len(position_m) == 0 else f"a particle at {position_m[np.argmin(inside)]} m"
        raise InputError(
            f"place: given {given}; allowed are centres inside the bin, from {bed.lower_m} to {bed.upper_m} m"
        )


def finite_rows(name: str, given: np.ndarray, count: int) -> np.ndarray:
    """`given` as (count, 3) float64.

    Raises:
        InputError: rows are missing or not finite.
    """
    rows = np.array(given, np.float64).reshape(-1, 3)
    finite = int(np.isfinite(rows).all(axis=1).sum())
    if len(rows) != count or finite != count:
        raise InputError(
            f"place: given {len(rows)} rows of {name}, {finite} finite; they must be {count}, all finite"
        )
    return rows
