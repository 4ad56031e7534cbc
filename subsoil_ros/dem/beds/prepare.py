"""Preparation of the bed that a scene describes."""

from pathlib import Path

from ...loading.loader import ResolvedScene
from ...scene.bed_kinds import GridBed, SavedBed, TiledBed
from ..bed import Bed, prepare_grid
from ..field import Field
from ..periodic import refuse_narrow_period
from .bed_file import read_bed
from .block import kept_block
from .cache import cached_bed_path, keep, load_cached
from .dense import prepare_dense
from .settling_progress import OnProgress, ignore_progress
from .start import nominal_box, refuse_tight_grid
from .tiled import prepare_tiled


def prepare_bed(resolved: ResolvedScene, threads: int = 1, on_progress: OnProgress = ignore_progress) -> Bed:
    """The bed of the scene's soil, or the first window of its field.

    A bed that takes long to prepare is kept in the user's cache folder and taken from there the next time;
    `on_progress` receives the progress of its preparation.

    Raises:
        SceneError: a bin too small for a particle, particles that overlap too far, an unfit bed file.
    """
    soil = resolved.scene.particle_soil
    assert soil is not None
    if isinstance(soil.bed, GridBed):
        refuse_tight_grid(soil)
        bed = prepare_grid(soil, resolved.scene.gravity_m_per_s2)
        refuse_narrow_period(bed, soil)
        return bed
    if isinstance(soil.bed, SavedBed):
        return read_bed(Path(soil.bed.file), soil)
    if soil.window is not None:
        field = Field(kept_block(resolved, threads, on_progress), soil)
        return field.bed(*field.first_window)
    refuse_narrow_period(nominal_box(soil), soil)
    path = cached_bed_path(resolved)
    kept = load_cached(path, soil)
    if kept is None and isinstance(soil.bed, TiledBed):
        kept = prepare_tiled(resolved, threads, on_progress)
        keep(path, kept, soil)
    elif kept is None:
        kept = prepare_dense(resolved, soil.bed.seed, threads, on_progress)
        keep(path, kept, soil)
    return kept
