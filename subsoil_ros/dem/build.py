"""The soil engine of a scene, with the bed that it describes."""

from ..errors import InputError
from ..loading.loader import ResolvedScene
from .beds.block import kept_block
from .beds.prepare import prepare_bed
from .engine import SoilEngine
from .field import Field
from .kernel_calls import refuse_threads
from .window import Window


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
    if soil.window is not None:
        window = Window(Field(kept_block(resolved, threads), soil))
        bed = window.field.bed(*window.field.first_window)
    else:
        bed = prepare_bed(resolved, threads)
    engine = SoilEngine(resolved, bed, threads, book=book, window=window)
    engine.refuse_step_too_large()
    return engine
