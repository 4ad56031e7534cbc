"""Strength, stiffness and density of the soil of a scene, by element tests of one cell and a heap."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..dem.build import build_engine
from ..dem.packing.relaxation import SETTLING_GRAVITY
from ..errors import InputError
from ..loading.loader import ResolvedScene, load_scene
from ..scene.bed_kinds import TiledBed
from ..yaml_document import Document
from .element_tests import (
    CRITICAL_STRAIN,
    LEAST_PA,
    Strength,
    confined_modulus_pa,
    fit_strength,
    plane_strain,
    prepare_cell,
    tensile_strength_pa,
)

Working = Callable[[str], AbstractContextManager[object]]
"""Shows what is in progress."""


class SoilStrength(NamedTuple):
    """Results of one soil."""

    density_kg_per_m3: float  # of the cell, at the start of the tests
    peak: Strength
    critical: Strength
    tensile_strength_pa: float
    confined_modulus_pa: float  # secant from 10 to 100 kPa
    repose_deg: float  # 90: a column stands


def measure_strength(resolved: ResolvedScene, threads: int, working: Working) -> SoilStrength:
    """Test the particles, the law and the bonds of a scene's soil; of one with layers, those of `soil.law`.

    Raises:
        InputError: the scene has no particles, or its bed is not tiled.
        RunError: the cell does not reach a stress.
    """
    soil = resolved.scene.particle_soil
    if soil is None:
        raise InputError(f"{resolved.path}: has no soil of particles, so there is nothing to test")
    if not isinstance(soil.bed, TiledBed):
        raise InputError(
            f"{resolved.path}: soil.bed.kind: '{soil.bed.kind}' given; the cell of a test is a tile: add "
            "--set soil.bed='{kind: tiled}', with the solid_fraction of your soil"
        )
    with working("pressing a cell"):
        cell = prepare_cell(resolved, threads)
    curves = []
    for least in LEAST_PA:
        with working(f"plane strain under {1e-3 * least:g} kPa"):
            curves.append(plane_strain(cell, least, CRITICAL_STRAIN, to_peak=False))
    with working("tension"):
        tension = tensile_strength_pa(cell)
    with working("confined compression"):
        modulus = confined_modulus_pa(cell)
    with working("angle of repose"):
        repose = repose_rad(resolved, threads)
    return SoilStrength(
        density_kg_per_m3=float(np.mean([curve.density_kg_per_m3 for curve in curves])),
        peak=fit_strength(*zip(*(curve.peak_pa() for curve in curves), strict=True)),
        critical=fit_strength(*zip(*(curve.critical_pa() for curve in curves), strict=True)),
        tensile_strength_pa=tension,
        confined_modulus_pa=modulus,
        repose_deg=math.degrees(repose),
    )


COLUMN = (8, 4, 14)
"""Spheres along x, y and z of the column."""

LOOSE = 1.075
"""Distance of the column's spheres over their diameter: none overlap after random shifts of 0.1 radii."""

ROOM = 5.0
"""Length of the bin over that of the column: the heap ends in it."""

FALLS = 7.0
"""Duration of a collapse in times of free fall from the column's height: the heap is then at rest."""

SLOPE_PART = (0.15, 0.85)
"""Part of the heap's height that the line of its slope is fitted to: foot and wall bend the slope."""

STANDS = 8.0
"""Height in radii above which what has no slope stands like a wall; lower, it is a layer."""


def repose_rad(resolved: ResolvedScene, threads: int = 1) -> float:
    """Slope of the heap that a loose column of a scene's soil against the near wall of a narrow bin falls
    into; pi / 2 if it stands.

    Spheres are equal, those of mean volume, and without bonds; walls and floor are as rough as they are.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None
    radius = soil.particles.mean_volume_radius_m
    step = 2.0 * LOOSE * radius
    length, width, height = (step * count for count in COLUMN)
    gravity = resolved.scene.gravity_m_per_s2 or SETTLING_GRAVITY
    law = soil.law.model_dump(mode="json")
    document: Document = {
        "name": "repose",
        "duration_s": FALLS * math.sqrt(2.0 * height / gravity),
        "gravity_m_per_s2": gravity,
        "allow": list(resolved.scene.allow),
        "soil": {
            "bin": {"length_m": ROOM * length, "width_m": width, "depth_m": height},
            "particles": soil.particles.model_dump(mode="json") | {"radius_m": radius, "sizes": None},
            "bed": {"kind": "grid", "spacing_m": "rest"},
            "law": law | {"boundary": law["particle"]},
        },
    }
    alone = load_scene(document)
    engine = build_engine(alone, threads)
    cells = np.stack(np.meshgrid(*map(range, COLUMN), indexing="ij"), axis=-1).reshape(-1, 3)
    shaken = np.random.default_rng(0).uniform(0.0, 0.1 * radius, cells.shape)
    engine.place(np.array(engine.bed.lower_m) + radius + step * cells + shaken)
    engine.start(())
    for tick in range(alone.timing.tick_count):
        engine.advance(tick, ())
    return slope_rad(engine.positions_m(), radius)


def slope_rad(positions_m: NDArray[np.float64], radius_m: float) -> float:
    """Slope of a heap (n, 3) of equal spheres that falls off along x: a line through the tops of slices one
    diameter wide; pi / 2 for one that stands like a wall, 0 for a layer."""
    x, z = positions_m[:, 0], positions_m[:, 2] - positions_m[:, 2].min()
    slices = np.floor(x / (2.0 * radius_m)).astype(int)
    tops = np.array([z[slices == s].max(initial=0.0) for s in range(slices.max() + 1)])
    middle = (np.arange(len(tops)) + 0.5) * 2.0 * radius_m
    low, high = SLOPE_PART
    slope = (tops > low * tops.max()) & (tops < high * tops.max())
    if slope.sum() < 3:
        return 0.5 * math.pi if tops.max() > STANDS * radius_m else 0.0
    return -math.atan(np.polyfit(middle[slope], tops[slope], 1)[0])
