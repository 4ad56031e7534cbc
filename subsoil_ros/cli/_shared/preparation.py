"""Messages about work before a run that may take a minute: the compilation of kernels.

All messages go to standard error: on a terminal one changing line, in a log one line before and one after.
"""

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from ...cache_folders import kernel_cache_folder
from ...kernel_cache import CompilationListener, soil_kernels_are_kept

if TYPE_CHECKING:
    from ...api.run_frame import RunFrame


def say(line: str) -> None:
    """Print one line on standard error."""
    print(line, file=sys.stderr, flush=True)


def say_opened(frame: "RunFrame") -> None:
    """Print warnings on standard error and notes on standard output before a run begins."""
    for warning in frame.warnings:
        say(f"warning: {warning}")
    for note in frame.notes:
        print(note, flush=True)


class KernelAnnouncer(CompilationListener):
    """Announces compilation on standard error. Use as context manager."""

    def __init__(self) -> None:
        super().__init__(say)

    def before(self, on_tick: Callable[[int], None]) -> Callable[[int], None]:
        """Return `on_tick`, preceded at the first tick by the report of the compilation."""

        def told(tick: int) -> None:
            self.done()
            on_tick(tick)

        return told


def announce_kernels_of_nodes(on_tick: Callable[[int], None]) -> Callable[[int], None]:
    """Announce that the nodes compile their kernels, if the kernels are not in the cache yet.

    Returns `on_tick`, which then reports at the first tick how long that took.
    """
    if soil_kernels_are_kept():
        return on_tick
    say(f"the nodes compile their kernels, once: kept in {kernel_cache_folder()}")
    waiting = [time.monotonic()]

    def told(tick: int) -> None:
        while waiting:
            say(f"first tick of the nodes after {time.monotonic() - waiting.pop():.0f} s")
        on_tick(tick)

    return told
