"""Progress on standard error: of a run, of many, of a bed, of kernels that compile, of other work of seconds.

On a terminal one changing line or bar, in a log one line before and one after.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column
from rich.text import Text

from ..cache_folders import kernel_cache_folder
from ..kernel_cache import CompilationListener, soil_kernels_are_kept
from ..ticks import tick_end_s
from .interrupts import end_if_interrupted
from .output import say

if TYPE_CHECKING:
    from ..dem.bed import OnProgress, RestProgress
    from ..limits.stable_steps import Timing


_SHOWN_PARTS = 200
"""Most updates of the bar while a bag is read: there may be millions of messages."""

_REFRESHES_PER_S = 4
"""Refreshes of a bar per second: few, because drawing takes CPU time from the work."""


class _SpeedColumn(ProgressColumn):
    """Simulated seconds per second of wall time."""

    def __init__(self) -> None:
        super().__init__(table_column=Column(no_wrap=True))

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("starting" if speed is None else f"{speed:.3g} x real time")


class RunProgress:
    """A bar on standard error. Use as context manager, and call with each tick that is done."""

    def __init__(self, name: str, timing: Timing) -> None:
        self._name = name
        self._communication_step_ns = timing.communication_step_ns
        duration_s = tick_end_s(timing.tick_count - 1, timing.communication_step_ns)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.3f} of {task.total:.3f} s"),
            _SpeedColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            refresh_per_second=_REFRESHES_PER_S,
            speed_estimate_period=30.0,
        )
        self._task = self._progress.add_task(name, total=duration_s)

    def __enter__(self) -> RunProgress:
        self._progress.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._progress.stop()

    def note(self, words: str) -> None:
        """Show words beside the name of the run."""
        self._progress.update(self._task, description=f"{self._name} ({words})")

    def __call__(self, tick: int) -> None:
        self._progress.update(self._task, completed=tick_end_s(tick, self._communication_step_ns))


def _bar(*columns: ProgressColumn, transient: bool = True) -> Progress:
    """Return a bar that is not drawn without a terminal; transient: it is removed when its work is done."""
    console = Console(stderr=True)
    return Progress(
        *columns,
        console=console,
        transient=transient,
        disable=not console.is_terminal,
        refresh_per_second=_REFRESHES_PER_S,
    )


def _counting() -> tuple[ProgressColumn, ...]:
    return TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show that `what` is in progress, and for how long; for work of unknown length."""
    with _bar(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()) as progress:
        progress.add_task(what, total=None)
        yield


@contextmanager
def counted(what: str, count: int) -> Iterator[Callable[[], None]]:
    """Show a bar over `count` items; yields a callback to call after each."""
    with _bar(*_counting()) as progress:
        task = progress.add_task(what, total=count)
        yield lambda: progress.advance(task)


@contextmanager
def reading_bag(timing: Timing) -> Iterator[Callable[[int], None]]:
    """Show a bar over the time of a bag; yields a callback that takes each message's time [ns]."""
    end_ns = timing.tick_count * timing.communication_step_ns
    shown_ns = 0
    with _bar(TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()) as progress:
        task = progress.add_task("reading the bag", total=end_ns)

        def show(time_ns: int) -> None:
            nonlocal shown_ns
            if (time_ns - shown_ns) * _SHOWN_PARTS >= end_ns:
                shown_ns = time_ns
                progress.update(task, completed=time_ns)

        yield show


@contextmanager
def bed_progress(what: str) -> Iterator[OnProgress]:
    """Show the preparation of a bed; yields the callback of its progress."""
    start = time.monotonic()
    with _bar(TextColumn("{task.description}"), TimeElapsedColumn()) as progress:
        if progress.disable:
            say(f"preparing a {what}")
        task = progress.add_task(f"{what}: starting")
        yield lambda look: progress.update(task, description=f"{what}: {_text(look)}")
    say(f"prepared a {what} in {time.monotonic() - start:.0f} s")


def _text(look: RestProgress) -> str:
    return (
        f"{look.phase}, {look.simulated_s:.3f} s of at most {look.longest_s:.3f}, "
        f"rms speed {1e3 * look.rms_speed_m_per_s:.1f} mm/s (rest: {1e3 * look.rest_speed_m_per_s:.1f})"
    )


class SweepProgress:
    """Bars on standard error in a terminal, a line per run elsewhere. Use as context manager."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._bars = _bar(*_counting(), transient=False)
        self._all = self._bars.add_task(title, total=None, visible=False)
        self._tasks: dict[str, TaskID] = {}
        self._ended: set[str] = set()  # progress of a run may arrive after its end
        self._done = self._count = 0

    def begin(self, kept: int, count: int) -> None:
        """Start: `kept` of `count` runs are in the cache already."""
        end_if_interrupted()
        self._done, self._count = kept, count
        before = "" if kept == count else "; the first ticks follow when beds and kernels are ready"
        self._say(f"{self._title}: {count} runs, {kept} of them kept from before{before}")
        self._bars.update(self._all, total=count, completed=kept, visible=True)

    def went_on(self, name: str, part: float) -> None:
        """Update: a run has done this part of its ticks."""
        if name in self._ended:
            return
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(escape(name), total=100)
            if self._bars.disable:
                self._say(f"started: {name}")
        self._bars.update(self._tasks[name], completed=round(100.0 * part))

    def ended(self, name: str, failure: str | None) -> None:
        """End of a run: its result is kept."""
        self._done += 1
        self._ended.add(name)
        self._bars.update(self._all, completed=self._done)
        if name in self._tasks:
            self._bars.remove_task(self._tasks.pop(name))
        if failure is not None:
            self._say(f"failed: {name}: {failure}")
        elif self._bars.disable:
            self._say(f"done: {name}; {self._done} of {self._count}")
        end_if_interrupted()

    def _say(self, line: str) -> None:
        """Print a line above the bars."""
        self._bars.console.print(line, markup=False, highlight=False, soft_wrap=True)

    def __enter__(self) -> SweepProgress:
        self._bars.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bars.stop()


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
    say(f"the nodes compile their kernels, once, in 1 to 4 minutes: kept in {kernel_cache_folder()}")
    waiting = [time.monotonic()]

    def told(tick: int) -> None:
        while waiting:
            say(f"first tick of the nodes after {time.monotonic() - waiting.pop():.0f} s")
        on_tick(tick)

    return told
