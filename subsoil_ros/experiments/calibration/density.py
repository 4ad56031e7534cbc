"""Density of the bed that the particles of a scene make."""

from ...dem.beds.prepare import prepare_bed
from ...dem.beds.report import report_bed
from ...dem.engine import SoilEngine
from ...loading.loader import ResolvedScene


def bed_density_kg_per_m3(scene: ResolvedScene, threads: int = 1) -> float:
    """Mass over the volume between walls, floor and mean top."""
    soil = scene.scene.particle_soil
    assert soil is not None
    return float(report_bed(prepare_bed(scene, SoilEngine, threads), soil).density_kg_per_m3)
