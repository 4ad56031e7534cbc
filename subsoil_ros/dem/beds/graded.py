"""Graded beds: beds of several sizes about a core (scene.coarse), pressed together as a tile is (tile).

Random points of every size, where it belongs, are pushed apart and pressed as one box that repeats itself. So
its interfaces are at most 3 % denser than the soil on both sides.
"""

import dataclasses

import numpy as np

from ...loading.loader import ResolvedScene
from ...scene.beds import TiledBed
from ...scene.sizes import sampled_radii_m
from ...scene.soil import Soil
from ..bed import Bed
from .settling import EngineOf, OnProgress
from .tile import START_BELOW, Pressing, pressed, tile_edge_m

LATTICE = 400
"""Cells along y and z of the section, each of the size that belongs in its middle."""

SHRINKS = 1.01
"""Edges of a box at the wanted solid fraction over the least that must remain: pressing and law may raise
the fraction by 0.5 and 2 % (tile.FRACTION_TOLERANCE, tiled.LARGEST_CHANGE)."""


def grades_at(soil: Soil, y_m: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
    """(n,) int64: the size that belongs at each place, by number from the core outwards."""
    coarse = soil.particles.coarse
    assert coarse is not None
    ends = coarse.ends_m(soil.particles.grades[0].mean_volume_radius_m)
    return np.searchsorted(ends, coarse.distance_m(y_m, depth_m), side="right").astype(np.int64)


def _lattice(
    soil: Soil, across_m: tuple[float, float], deep_m: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Points of a section, (LATTICE^2, 2) y and depth [m], and the size that belongs at each."""
    middles = (np.arange(LATTICE) + 0.5) / LATTICE
    (y, depth), (y_end, depth_end) = zip(across_m, deep_m, strict=True)
    places = np.meshgrid(y + (y_end - y) * middles, depth + (depth_end - depth) * middles)
    section = np.column_stack([along.ravel() for along in places])
    return section, grades_at(soil, *section.T)


def grade_parts(soil: Soil, across_m: tuple[float, float], deep_m: tuple[float, float]) -> np.ndarray:
    """(sizes,) part of the section from y to y and depth to depth where each size belongs."""
    _, belongs = _lattice(soil, across_m, deep_m)
    return np.bincount(belongs, minlength=len(soil.particles.grades)) / LATTICE**2


def pressed_graded(
    resolved: ResolvedScene,
    size_m: tuple[float, float, float],
    above_m: float,
    engine_of: EngineOf,
    threads: int,
    on_progress: OnProgress,
) -> Bed:
    """Endless graded bed, pressed, at least of this size along x, y and z; the surface of the soil is
    `above_m` below its top.

    The friction of the pressing is searched on a piece as long as a tile.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None

    def pressing(length_m: float) -> Pressing:
        points = _random_points(soil, (length_m, *size_m[1:]), above_m)
        return Pressing(resolved, soil, points, engine_of, threads, on_progress)

    short = min(size_m[0], tile_edge_m(soil))
    found = pressed(pressing(short))
    return (found if short == size_m[0] else pressing(size_m[0]).at(found.friction)).bed


def _random_points(soil: Soil, size_m: tuple[float, float, float], above_m: float) -> Bed:
    assert isinstance(soil.bed, TiledBed)
    wanted, rng = soil.bed.solid_fraction, np.random.default_rng(soil.bed.seed)
    size = SHRINKS * np.array(size_m)
    section, belongs = _lattice(soil, (-0.5 * size[1], 0.5 * size[1]), (-above_m, size[2] - above_m))
    places, radii = [], []
    for k, grade in enumerate(soil.particles.grades):
        assert grade.sizes is not None
        cells = np.flatnonzero(belongs == k)
        sphere = 4.0 / 3.0 * np.pi * grade.mean_volume_radius_m**3
        count = round(wanted * float(np.prod(size)) * len(cells) / LATTICE**2 / sphere)
        y, depth = (section[rng.choice(cells, count)] if len(cells) else section[:0]).T
        x, aside, deeper = rng.uniform(-0.5, 0.5, (3, count))
        y, depth = y + aside * size[1] / LATTICE, depth + deeper * size[2] / LATTICE
        places.append(np.column_stack(((x + 0.5) * size[0], y, -above_m - depth)))
        radii.append(sampled_radii_m(grade.sizes, count))
    looser = (wanted / (wanted - START_BELOW)) ** (1.0 / 3.0)
    length, width, height = (looser * size).tolist()
    return Bed(
        looser * np.concatenate(places),
        (0.0, -0.5 * width, -height),
        (length, 0.5 * width),
        radii_m=np.concatenate(radii),
        materials=np.repeat(np.arange(len(radii)), list(map(len, radii))),
        sides="endless",
    )


def boxed(bed: Bed) -> Bed:
    """The endless bed, particles moved into its box by whole periods."""
    low, periods = np.array(bed.lower_m), np.array(bed.periods_m)
    return dataclasses.replace(bed, positions_m=low + (bed.positions_m - low) % periods)
