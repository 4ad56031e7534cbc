"""Interface of what observes a run: its progress, its checks, and the request to end it."""

from collections.abc import Callable

from ..yaml_document import Document


class RunObserver:
    """Observes a run and ignores all; a subclass overrides what it is for."""

    def on_tick(self, tick: int) -> None:
        """Note that `tick` is done and written."""

    def on_check(self, result: Document) -> None:
        """Note the result of `stop_when` at a check and at the end, in the form of summary.json."""

    def stop_signal(self) -> int:
        """Number of the signal that ends the run before its next tick; 0: it goes on."""
        return 0


class RunWatch(RunObserver):
    """Keeps whether a run has begun, the last result of `stop_when`, and the signals to end it.

    show: called with each tick.
    """

    def __init__(self, show: Callable[[int], None] = lambda tick: None) -> None:
        self.started = False
        self.stop_when: Document = {}
        self.followed: Document = {}  # of a run that follows a machine, in the form of summary.json
        self.signals: list[int] = []
        self.show = show

    def on_tick(self, tick: int) -> None:
        """Note that the run has begun, and show the tick."""
        self.started = True
        self.show(tick)

    def on_check(self, result: Document) -> None:
        """Keep the result."""
        self.stop_when = dict(result)

    def stop_signal(self) -> int:
        """The first signal; 0 without one."""
        return self.signals[0] if self.signals else 0
