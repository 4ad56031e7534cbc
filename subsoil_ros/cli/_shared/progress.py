"""Progress on standard error: of a run (simulated time, speed, time left), and of other work of seconds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column
from rich.text import Text

from ...ticks import tick_end_s

if TYPE_CHECKING:
    from ...limits.stable_steps import Timing


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


_SHOWN_PARTS = 200
"""Most updates of the bar while a bag is read: there may be millions of messages."""

_REFRESHES_PER_S = 4
"""Refreshes of a bar per second: few, because drawing takes CPU time from the work."""


def _bar(*columns: ProgressColumn) -> Progress:
    """Return a bar that is removed when its work is done, and not drawn without a terminal."""
    console = Console(stderr=True)
    return Progress(
        *columns,
        console=console,
        transient=True,
        disable=not console.is_terminal,
        refresh_per_second=_REFRESHES_PER_S,
    )


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show that `what` is in progress, and for how long; for work of unknown length."""
    with _bar(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()) as progress:
        progress.add_task(what, total=None)
        yield


@contextmanager
def counted(what: str, count: int) -> Iterator[Callable[[], None]]:
    """Show a bar over `count` items; yields a callback to call after each."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with _bar(*columns) as progress:
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
