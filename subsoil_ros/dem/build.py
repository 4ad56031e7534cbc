"""The bed that a scene describes, prepared or from the user's cache, and the soil engine with it."""

from pathlib import Path

from ..errors import InputError
from ..loading.loader import ResolvedScene
from ..scene.bed_kinds import GridBed, SavedBed, TiledBed
from .bed import Bed, OnProgress, ignore_progress
from .engine import SoilEngine
from .field import Field
from .kernel_calls import refuse_threads
from .packing.bed_file import bed_path, load_bed, read_bed, store_bed
from .packing.dense_random import prepare_dense
from .packing.field_sample import cached_field_sample
from .packing.grid import prepare_grid, refuse_tight_grid
from .packing.replicate import prepare_tiled
from .packing.start import nominal_box
from .periodic import refuse_narrow_period
from .window import Window


def prepare_bed(resolved: ResolvedScene, threads: int = 1, on_progress: OnProgress = ignore_progress) -> Bed:
    """The bed of the scene's soil, the first window of its field or, for LAMMPS, the whole of it.

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
        field = Field(cached_field_sample(resolved, threads, on_progress), soil)
        return field.bed(*(field.first_window if soil.moving_window is not None else (0, field.count)))
    refuse_narrow_period(nominal_box(soil), soil)
    path = bed_path(resolved)
    kept = load_bed(path, soil)
    if kept is None and isinstance(soil.bed, TiledBed):
        kept = prepare_tiled(resolved, threads, on_progress)
        store_bed(path, kept, soil)
    elif kept is None:
        kept = prepare_dense(resolved, soil.bed.seed, threads, on_progress)
        store_bed(path, kept, soil)
    return kept


def build_engine(resolved: ResolvedScene, threads: int = 1, *, book: bool = False) -> SoilEngine:
    """The engine of a scene; see SoilEngine. Its bed is prepared, or taken from the user's cache.

    Raises:
        InputError: as SoilEngine.
        SceneError: a bed that cannot be made, or a step that is too large for it.
    """
    soil = resolved.scene.particle_soil
    if soil is None:
        raise InputError(f"{resolved.path}: has no 'soil', so it needs no soil engine")
    refuse_threads(threads)
    window = None
    if soil.moving_window is not None:
        window = Window(Field(cached_field_sample(resolved, threads), soil))
        bed = window.field.bed(*window.field.first_window)
    else:
        bed = prepare_bed(resolved, threads)
    engine = SoilEngine(resolved, bed, threads, book=book, window=window)
    engine.refuse_step_too_large()
    return engine
