"""What precedes a run and may take a minute, announced: kernels to compile.

Everything goes to standard error. A terminal sees one line that changes; a log gets a line before and one
after.
"""

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from ...kernel_cache import CompilationListener, kernel_cache_folder, soil_kernels_are_kept

if TYPE_CHECKING:
    from ...api.opened_run import OpenedRun


def say(line: str) -> None:
    """One line on standard error."""
    print(line, file=sys.stderr, flush=True)


def say_opened(opened: "OpenedRun") -> None:
    """What is to be said of a run before it begins: warnings on standard error, notes on standard output."""
    for warning in opened.warnings:
        say(f"warning: {warning}")
    for note in opened.notes:
        print(note, flush=True)


class KernelAnnouncer(CompilationListener):
    """Announces compilation on standard error. Use as context manager."""

    def __init__(self) -> None:
        super().__init__(say)

    def before(self, on_tick: Callable[[int], None]) -> Callable[[int], None]:
        """`on_tick`, told first what the tick was waiting for."""

        def told(tick: int) -> None:
            self.done()
            on_tick(tick)

        return told


def announce_kernels_of_nodes(on_tick: Callable[[int], None]) -> Callable[[int], None]:
    """Where the soil's kernels are not kept yet: says what the other processes do before their first tick.

    Returns `on_tick`, which then says at the first tick how long it took.
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
