"""The wall time of a run, without pauses."""

import time


class RunClock:
    """Measures wall time from `start` on [s]; 0 before."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._stopped: float | None = self._start  # start of the present pause; None: the clock runs

    def start(self, before_s: float = 0.0) -> None:
        """Start the clock at `before_s`, the time of earlier runs in a resumed one."""
        self._start, self._stopped = time.monotonic() - before_s, None

    def stand(self, standing: bool) -> None:
        """Stop the clock while the run stands."""
        now = time.monotonic()
        if self._stopped is not None:
            self._start += now - self._stopped
        self._stopped = now if standing else None

    @property
    def elapsed_s(self) -> float:
        """The wall time so far."""
        now = time.monotonic() if self._stopped is None else self._stopped
        return now - self._start
