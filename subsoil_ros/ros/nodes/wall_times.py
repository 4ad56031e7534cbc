"""Wall times of a run, as the coupler sees them: since its start, and of a tick."""

import statistics
import time
from collections import deque

from ...coupling.time_limits import GRANTED_S
from ...ticks import INITIAL_TICK

FIRST_GRANTS = 8
"""Ticks granted ahead before the time of a tick is known."""

KEPT = 101
"""Number of times that are kept, odd, so that the median is one of them."""

SHORTEST = 1e-6
"""Time of a tick [s]: no message takes less."""


class RunClock:
    """Wall time of a run from `start` on [s], without pauses; 0 before."""

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


class TickTimes:
    """Mean times of the ticks that were seen to finish together, those of the last KEPT batches."""

    def __init__(self) -> None:
        self._since = INITIAL_TICK, time.monotonic()
        self._times_s: deque[float] = deque(maxlen=KEPT)

    def restart(self, tick: int) -> None:
        """Do not count the time up to now, at the end of `tick`: nothing was granted."""
        self._since = tick, time.monotonic()

    def note(self, tick: int) -> None:
        """Note that all ticks up to `tick` have finished."""
        before, since = self._since
        if tick > before:
            self.restart(tick)
            self._times_s.append(max((self._since[1] - since) / (tick - before), SHORTEST))

    @property
    def median_s(self) -> float:
        """Median; 0 before the first tick."""
        return statistics.median(self._times_s) if self._times_s else 0.0

    @property
    def ahead(self) -> int:
        """Number of ticks that take GRANTED_S, at least 1; by the last ticks where they are slower."""
        if not self._times_s:
            return FIRST_GRANTS
        return max(1, int(GRANTED_S / max(self.median_s, self._times_s[-1])))
