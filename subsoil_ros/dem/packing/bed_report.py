"""Report of a bed: density, bonds, surface, gaps at walls, voids, and its motion when left alone."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from ...limits.stable_steps import step_limits
from ...scene.pair_laws import layer_soils
from ...scene.soil import Soil
from ..bed import Bed, radii_of
from ..walls import WALLS, wall_planes
from .bed_geometry import bed_tree, pairs_in_reach, seen_from_corner, top_surface_m

INSIDE_DIAMETERS = 2.0
"""Distance from walls, floor and top beyond which a bed counts as inside: layers at walls fade by then."""

GAP_CELL = 4.0
"""Edge of the cells over which gaps at a wall are taken, in radii: each holds some four particles of a dense
layer, of which the nearest touches."""

VOID_REFINEMENTS = 5
"""Halvings of the lattice, one radius wide at first, about the largest voids: to r / 32."""

VOID_NEIGHBOURS = 16
"""Nearest centres among which the nearest surface is sought, between unequal particles: the large particle
that it belongs to is seldom behind so many small ones."""

VOID_CANDIDATES = 64
"""Lattice points that are refined to find the largest void; with few, one that the lattice misses is lost."""


@dataclass(frozen=True)
class WallGap:
    """Free distance from a wall to the nearest particle, over cells GAP_CELL wide; negative: overlap."""

    mean_m: float
    max_m: float


@dataclass(frozen=True)
class RadiusReport:
    """Radii of the particles, by number."""

    min_m: float
    mean_m: float
    max_m: float
    deviation_m: float  # standard


@dataclass(frozen=True)
class LayerReport:
    """Particles of one layer; density is their mass over the volume between the layer's depths."""

    name: str
    particle_count: int
    density_kg_per_m3: float


@dataclass(frozen=True)
class BedReport:
    """State of a bed; world axes."""

    particle_count: int
    radii: RadiusReport | None  # of several sizes
    layers: tuple[LayerReport, ...]  # from top to bottom; empty without
    density_kg_per_m3: float  # mass of what may move over the volume between walls, floor and mean top
    density_inside_kg_per_m3: float  # INSIDE_DIAMETERS away from walls, floor and top; nan: nothing is
    coordination: float  # particles in reach of a particle, mean
    max_overlap_m: float  # beyond rest
    top_mean_m: float
    top_spread_m: float  # standard deviation over columns one radius apart
    floor_m: float
    wall_gaps: dict[str, WallGap]  # by dem.walls.WALLS
    max_void_radius_m: float  # of a sphere between particles, walls and surface
    max_void_at_m: tuple[float, float, float]
    kinetic_energy_joule: float  # left when the preparation ended
    stable_step_s: float  # at the measured coordination


def report_bed(bed: Bed, soil: Soil) -> BedReport:
    """Report of a bed as prepared, or in another state: replace `positions_m`. Of a window, densities, voids
    and surface are those between the layers that are held at its ends and sides, and it has no walls."""
    radius = soil.particles.mean_volume_radius_m
    count, bonds = len(bed.positions_m), pairs_in_reach(bed, soil)
    coordination = 2.0 * len(bonds.pair) / count
    if soil.window is not None:
        bed = _between_held(bed, radius)
    radii, masses = radii_of(bed, soil), masses_kg(bed, soil)
    top = top_surface_m(bed, radius)
    length, width = bed.upper_m[0] - bed.lower_m[0], bed.upper_m[1] - bed.lower_m[1]
    free = np.ones(len(masses), np.bool_) if bed.held is None else ~bed.held
    volume = length * width * (float(top.mean()) - bed.floor_m)
    void, at = _largest_void(bed, radii, top, radius)
    return BedReport(
        particle_count=count,
        radii=None if bed.radii_m is None else _radii(bed.radii_m),
        layers=_layers(bed, soil, masses * free, top, length * width),
        density_kg_per_m3=float(masses[free].sum()) / volume,
        density_inside_kg_per_m3=_density_inside(bed, masses, float(radii.max()), float(top.min())),
        coordination=coordination,
        max_overlap_m=float(bonds.excess_m.max(initial=0.0)),
        top_mean_m=float(top.mean()),
        top_spread_m=float(top.std()),
        floor_m=bed.floor_m,
        wall_gaps={} if soil.window is not None else _wall_gaps(bed, radii, top, radius),
        max_void_radius_m=void,
        max_void_at_m=at,
        kinetic_energy_joule=bed.kinetic_energy_joule,
        stable_step_s=step_limits(soil, max(coordination, 1.0))[0].limit_s,
    )


def _between_held(bed: Bed, radius: float) -> Bed:
    """The part of a window over which particles are free, a radius inside the outermost of them."""
    assert bed.held is not None
    free = bed.positions_m[~bed.held, :2]
    low, high = free.min(axis=0) + radius, free.max(axis=0) - radius
    inside = ((bed.positions_m[:, :2] > low) & (bed.positions_m[:, :2] < high)).all(axis=1)
    part = bed.only(inside)
    return dataclasses.replace(part, lower_m=(*low.tolist(), part.floor_m), upper_m=tuple(high.tolist()))


def _density_inside(bed: Bed, masses: np.ndarray, radius: float, top_m: float) -> float:
    """Mass over volume of the inner bed [kg/m3], weighted by sin^2 along each axis: a box cuts particles."""
    away = 2.0 * INSIDE_DIAMETERS * radius
    low = np.array([*bed.lower_m[:2], bed.floor_m]) + away
    size = np.array([*bed.upper_m, top_m]) - away - low
    if size.min() <= 0.0:
        return math.nan
    part = (bed.positions_m - low) / size
    inner = ((part > 0.0) & (part < 1.0)).all(axis=1)
    weight = (np.sin(np.pi * part[inner]) ** 2).prod(axis=1)
    return float((masses[inner] * weight).sum() / (size.prod() / 8.0))


def masses_kg(bed: Bed, soil: Soil) -> np.ndarray:
    """(n,) mass of every particle."""
    density = np.array([layer.particles.density_kg_per_m3 for layer in layer_soils(soil)])
    material = np.zeros(len(bed.positions_m), np.int64) if bed.materials is None else bed.materials
    return density[material] * 4.0 / 3.0 * np.pi * radii_of(bed, soil) ** 3


def _radii(radii: np.ndarray) -> RadiusReport:
    return RadiusReport(*(float(value) for value in (radii.min(), radii.mean(), radii.max(), radii.std())))


def _layers(
    bed: Bed, soil: Soil, masses: np.ndarray, top: np.ndarray, area_m2: float
) -> tuple[LayerReport, ...]:
    """Report of each layer of the soil, the first ending at `top`, the last at the floor."""
    if soil.layers is None or bed.materials is None:
        return ()
    found, upper = [], np.inf
    for k, layer in enumerate(soil.layers):
        lower = bed.floor_m
        if layer.thickness_m is not None:
            lower = max(lower, (0.0 if k == 0 else upper) - layer.thickness_m)
        volume = area_m2 * float(np.clip(np.minimum(top, upper) - lower, 0.0, None).mean())
        own = bed.materials == k
        density = float(masses[own].sum()) / volume if volume > 0.0 else 0.0
        found.append(LayerReport(f"layer {layer.name}", int(own.sum()), density))
        upper = lower
    return tuple(found)


def _wall_gaps(bed: Bed, radii: np.ndarray, top: np.ndarray, radius: float) -> dict[str, WallGap]:
    """Gaps at the walls; at side walls only below the surface."""
    planes = wall_planes(bed.lower_m, bed.upper_m, bed.sides)
    low = np.array(bed.lower_m)
    floor = bed.lower_m[2]
    edge_top = [_first_top(side, floor) for side in (top, top[::-1], top.T, top.T[::-1])]  # along side walls
    found = {}
    for wall, name in enumerate(WALLS):
        if not np.isfinite(planes[wall, 3]):
            continue  # a periodic side
        gap = planes[wall, 3] - bed.positions_m @ planes[wall, :3] - radii
        first, second = ((1, 2), (1, 2), (0, 2), (0, 2), (0, 1))[wall]
        high = [*bed.upper_m, float(np.mean(edge_top[wall]) if name != "floor" else 0.0)]
        if name != "floor" and edge_top[wall].max() <= floor:
            continue  # no bed at all
        size = np.array([high[first] - low[first], high[second] - low[second]])
        cells = np.maximum(1, np.floor(size / (GAP_CELL * radius)).astype(np.int64))
        place = np.floor((bed.positions_m[:, [first, second]] - low[[first, second]]) / (size / cells))
        place = place.astype(np.int64)
        inside = ((place >= 0) & (place < cells)).all(axis=1)
        nearest = np.full(cells, float(np.ptp(planes[wall, :3] @ bed.positions_m.T)))
        np.minimum.at(nearest, (place[inside, 0], place[inside, 1]), gap[inside])
        kept = nearest.ravel()
        if name != "floor":
            surface = np.array([part.min() for part in np.array_split(edge_top[wall], cells[0])])
            ceiling = low[2] + size[1] / cells[1] * (1 + np.arange(cells[1]))
            below = ceiling[None, :] <= surface[:, None] + radius
            kept = nearest[below] if below.any() else kept
        found[name] = WallGap(float(kept.mean()), float(kept.max()))
    return found


def _first_top(top: np.ndarray, floor: float) -> np.ndarray:
    """(n,) the first column of each row across `top` (m, n), seen from a wall, that holds a particle."""
    return top[np.argmax(top > floor, axis=0), np.arange(top.shape[1])]


def _largest_void(
    bed: Bed, radii: np.ndarray, top: np.ndarray, radius: float
) -> tuple[float, tuple[float, float, float]]:
    """Radius [m] and centre of the largest sphere found between particles, walls and surface.

    Of unequal particles the one of least distance less radius is sought among the VOID_NEIGHBOURS nearest.
    """
    tree = bed_tree(bed)
    candidates = 1 if bed.radii_m is None else min(VOID_NEIGHBOURS, len(radii))
    low, high = np.array(bed.lower_m), np.array([*bed.upper_m, float(top.max())])
    planes = wall_planes(bed.lower_m, bed.upper_m, bed.sides)
    pitch = (high[:2] - low[:2]) / top.shape

    def free(points: np.ndarray) -> np.ndarray:
        column = np.clip(((points[:, :2] - low[:2]) / pitch).astype(np.int64), 0, np.array(top.shape) - 1)
        under_top = top[column[:, 0], column[:, 1]] - points[:, 2]
        distance, at = tree.query(seen_from_corner(bed, points), k=[*range(1, candidates + 1)])
        to_particle = (distance - radii[at]).min(axis=1)
        to_wall = (planes[:, 3] - points @ planes[:, :3].T).min(axis=1)
        return np.minimum(np.minimum(to_particle, to_wall), under_top)

    axes = [np.arange(a + 0.5 * radius, b, radius) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    steps = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(1, -1, 3)
    size = free(points)
    for level in range(VOID_REFINEMENTS):
        best = np.argsort(-size, kind="stable")[:VOID_CANDIDATES]
        points = (points[best, None, :] + 0.5 ** (level + 1) * radius * steps).reshape(-1, 3)
        size = free(points)
    k = int(np.argmax(size))
    x, y, z = points[k].tolist()
    return max(0.0, float(size[k])), (x, y, z)
