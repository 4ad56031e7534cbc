"""Beds that take long, prepared before a run begins."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from ..dem.bed import OnProgress, ignore_progress
from ..dem.packing.bed_file import bed_path
from ..dem.packing.start import expected_dense_count
from ..loading.loader import ResolvedScene
from ..scene.bed_kinds import DenseRandomBed, TiledBed

BedProgress = Callable[[str], AbstractContextManager[OnProgress]]
"""Shows that a bed of this description is being prepared; yields the callback of its progress."""


def prepare_bed_first(resolved: ResolvedScene, threads: int, progress: BedProgress | None = None) -> None:
    """Prepare and cache a bed that takes long; the engine then finds it in the cache.

    Raises:
        SceneError: a bed that cannot be made.
    """
    soil = resolved.scene.particle_soil
    if soil is None or not isinstance(soil.bed, (DenseRandomBed, TiledBed)):
        return
    if bed_path(resolved).is_file():
        return
    kind = "tiled" if isinstance(soil.bed, TiledBed) else "dense random"
    what = f"{kind} bed of about {expected_dense_count(soil):,} particles"
    if soil.window is not None:
        what = "block that the field repeats"
    from ..dem.build import prepare_bed  # slow to import

    with progress(what) if progress is not None else nullcontext(ignore_progress) as on_progress:
        prepare_bed(resolved, threads, on_progress)
