"""The wall time of a run, without the time that it stands paused."""

import time


class RunClock:
    """Counts wall time from `start` on [s]; 0 before."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._stopped: float | None = self._start  # since when it does not count; None: it does

    def start(self, before_s: float = 0.0) -> None:
        """Counts from now on, after `before_s` of a run that goes on."""
        self._start, self._stopped = time.monotonic() - before_s, None

    def stand(self, standing: bool) -> None:
        """Stops while the run stands."""
        now = time.monotonic()
        if self._stopped is not None:
            self._start += now - self._stopped
        self._stopped = now if standing else None

    @property
    def elapsed_s(self) -> float:
        """The time so far."""
        now = time.monotonic() if self._stopped is None else self._stopped
        return now - self._start
