"""What precedes a run and may take a minute, announced: kernels to compile.

Everything goes to standard error. A terminal sees one line that changes; a log gets a line before and one
after.
"""

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from numba.core import event

from ...kernel_cache import kernel_cache_folder, soil_kernels_are_kept

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


class KernelAnnouncer(event.Listener):
    """Says before the first kernel is compiled that this happens, and in `done` how long it took.

    Kernels that come from the cache on disk are not compiled and pass in silence; so does what is still
    compiled after `done`, which is little. Use as context manager.
    """

    def __init__(self) -> None:
        self._depth = self._compiled = 0
        self._since = self._seconds = 0.0
        self._told = False

    def on_start(self, event: object) -> None:
        """A kernel, or one it calls, is compiled from here."""
        if self._compiled == 0:
            say(f"compiling kernels, once: kept in {kernel_cache_folder()}")
        if self._depth == 0:
            self._since = time.monotonic()
        self._depth += 1
        self._compiled += 1

    def on_end(self, event: object) -> None:
        """To here."""
        self._depth -= 1
        if self._depth == 0:
            self._seconds += time.monotonic() - self._since

    def done(self) -> None:
        """Says how long it took; once, and nothing if nothing was compiled."""
        if self._compiled and not self._told:
            self._told = True
            say(f"compiled {self._compiled} kernels in {self._seconds:.0f} s")

    def before(self, on_tick: Callable[[int], None]) -> Callable[[int], None]:
        """`on_tick`, told first what the tick was waiting for."""

        def told(tick: int) -> None:
            self.done()
            on_tick(tick)

        return told

    def __enter__(self) -> "KernelAnnouncer":
        event.register("numba:compile", self)
        return self

    def __exit__(self, *exception: object) -> None:
        event.unregister("numba:compile", self)
        self.done()


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
