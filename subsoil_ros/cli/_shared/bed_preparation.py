"""Progress of the preparation of a bed, on standard error."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from .preparation import say

if TYPE_CHECKING:
    from ...dem.bed import OnProgress, RestProgress


@contextmanager
def bed_progress(what: str) -> Iterator[OnProgress]:
    """Show the preparation of a bed; yields the callback of its progress."""
    console = Console(stderr=True)
    start = time.monotonic()
    if console.is_terminal:
        columns = (TextColumn("{task.description}"), TimeElapsedColumn())
        with Progress(*columns, console=console, refresh_per_second=2, transient=True) as progress:
            task = progress.add_task(f"{what}: starting")
            yield lambda look: progress.update(task, description=f"{what}: {_text(look)}")
    else:
        say(f"preparing a {what}")
        yield lambda look: None
    say(f"prepared a {what} in {time.monotonic() - start:.0f} s")


def _text(look: RestProgress) -> str:
    return (
        f"{look.phase}, {look.simulated_s:.3f} s of at most {look.longest_s:.3f}, "
        f"rms speed {1e3 * look.rms_speed_m_per_s:.1f} mm/s (rest: {1e3 * look.rest_speed_m_per_s:.1f})"
    )
