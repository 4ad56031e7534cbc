"""A dense bed prepared before a run, with progress on standard error."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from ..dem.beds.cache import cached_bed_path
from ..dem.beds.prepare import expected_dense_count, prepare_bed
from ..dem.beds.settling import Look, Watch, unwatched
from ..dem.engine import SoilEngine
from ..scene.beds import DenseRandomBed
from ..scene.loader import ResolvedScene
from .preparation import say


def prepare_bed_first(resolved: ResolvedScene, threads: int) -> None:
    """Prepares and caches a bed that takes long, with progress; the engine then finds it in the cache.

    Raises:
        SceneError: a bed that cannot be made.
    """
    soil = resolved.scene.particle_soil
    if soil is None or not isinstance(soil.bed, DenseRandomBed) or cached_bed_path(resolved).is_file():
        return
    with _bed_progress(f"dense random bed of about {expected_dense_count(soil):,} particles") as watch:
        prepare_bed(resolved, SoilEngine, threads, watch)


@contextmanager
def _bed_progress(what: str) -> Iterator[Watch]:
    """Gives what to tell how the preparation of a bed goes."""
    console = Console(stderr=True)
    start = time.monotonic()
    if console.is_terminal:
        columns = (TextColumn("{task.description}"), TimeElapsedColumn())
        with Progress(*columns, console=console, refresh_per_second=2, transient=True) as progress:
            task = progress.add_task(f"{what}: starting")
            yield lambda look: progress.update(task, description=f"{what}: {_text(look)}")
    else:
        say(f"preparing a {what}")
        yield unwatched
    say(f"prepared a {what} in {time.monotonic() - start:.0f} s")


def _text(look: Look) -> str:
    return (
        f"{look.phase}, {look.simulated_s:.3f} s of at most {look.longest_s:.3f}, "
        f"rms speed {1e3 * look.rms_speed_m_per_s:.1f} mm/s (rest: {1e3 * look.rest_speed_m_per_s:.1f})"
    )
