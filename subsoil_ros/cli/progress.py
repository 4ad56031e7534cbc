"""Progress of a run: simulated time, speed, time left."""

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.table import Column
from rich.text import Text

from ..scene.limits import Timing
from ..ticks import tick_end_s


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
        self._interval_ns = timing.interval_ns
        duration_s = tick_end_s(timing.tick_count - 1, timing.interval_ns)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.3f} of {task.total:.3f} s"),
            _SpeedColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            refresh_per_second=4,
            speed_estimate_period=30.0,
        )
        self._task = self._progress.add_task(name, total=duration_s)
        self.started = False
        """Whether a tick has been done."""

    def __enter__(self) -> "RunProgress":
        self._progress.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._progress.stop()

    def __call__(self, tick: int) -> None:
        self.started = True
        self._progress.update(self._task, completed=tick_end_s(tick, self._interval_ns))
