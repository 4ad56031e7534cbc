"""Strength, stiffness and density of the soil of a scene, by element tests of one cell and a heap."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import NamedTuple

import numpy as np

from ...errors import InputError
from ...loading.loader import ResolvedScene
from ...scene.bed_kinds import TiledBed
from .element import (
    CRITICAL_STRAIN,
    LEAST_PA,
    Strength,
    confined_modulus_pa,
    fit_strength,
    plane_strain,
    prepare_cell,
    tensile_strength_pa,
)
from .repose import repose_rad

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
