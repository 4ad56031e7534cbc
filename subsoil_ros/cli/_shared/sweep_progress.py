"""Progress of many runs: one bar for all of them and one for each that is running."""

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from .preparation import say


class SweepProgress:
    """Bars on standard error in a terminal, a line per run elsewhere. Use as context manager."""

    def __init__(self, title: str) -> None:
        console = Console(stderr=True)
        self._bars: Progress | None = None
        if console.is_terminal:
            self._bars = Progress(
                TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
                console=console, refresh_per_second=4,
            )  # fmt: skip
        self._title = title
        self._all: TaskID | None = None
        self._tasks: dict[str, TaskID] = {}
        self._ended: set[str] = set()  # progress of a run may arrive after its end
        self._done = self._count = 0

    def begin(self, kept: int, count: int) -> None:
        """Start: `kept` of `count` runs are in the cache already."""
        self._done, self._count = kept, count
        self._say(f"{self._title}: {count} runs, {kept} of them kept from before")
        if self._bars is not None:
            self._all = self._bars.add_task(self._title, total=count, completed=kept)

    def went_on(self, name: str, part: float) -> None:
        """Update: a run has done this part of its ticks."""
        if self._bars is None or name in self._ended:
            return
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(escape(name), total=100)
        self._bars.update(self._tasks[name], completed=round(100.0 * part))

    def ended(self, name: str, failure: str | None) -> None:
        """End of a run: its result is kept."""
        self._done += 1
        self._ended.add(name)
        if self._bars is not None and self._all is not None:
            self._bars.update(self._all, completed=self._done)
            if name in self._tasks:
                self._bars.remove_task(self._tasks.pop(name))
        if failure is not None:
            self._say(f"failed: {name}: {failure}")
        elif self._bars is None:
            self._say(f"done: {name}; {self._done} of {self._count}")

    def _say(self, line: str) -> None:
        """Print a line above the bars."""
        if self._bars is not None:
            self._bars.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            say(line)

    def __enter__(self) -> "SweepProgress":
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._bars is not None:
            self._bars.stop()
