"""Density of the bed that the particles of a scene make."""

from ...dem.beds.prepare import prepare_bed
from ...dem.beds.report import report_bed
from ...loading.loader import ResolvedScene
from ...scene.bed_kinds import TiledBed


def bed_density_kg_per_m3(scene: ResolvedScene, threads: int = 1) -> float:
    """Mass over the volume between walls, floor and mean top. For a tiled bed, of which a window has only a
    part, it follows from the solid fraction."""
    soil = scene.scene.particle_soil
    assert soil is not None
    if isinstance(soil.bed, TiledBed):
        return soil.bed.solid_fraction * soil.particles.density_kg_per_m3
    return float(report_bed(prepare_bed(scene, threads), soil).density_kg_per_m3)
