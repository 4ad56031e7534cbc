"""Check ticks, at whose end it is decided whether the run ends with the next tick."""

from ...errors import ProtocolError
from ...schedule import Schedule


class Checks:
    """Limit of the grants: no tick beyond a check tick is granted before its decision.

    The tick before the first one of a resumed run may be a check tick, too.
    """

    def __init__(self, schedule: Schedule) -> None:
        self._interval = schedule.check_ticks
        self._pending = schedule.next_check(schedule.first_tick - 1) if self._interval else None

    def decide(self, tick: int) -> None:
        """Note that the decision of check tick `tick` is made.

        Raises:
            ProtocolError: another check tick, or none, is to be decided.
        """
        if self._pending is None or tick != self._pending:
            awaited = "no tick" if self._pending is None else f"tick {self._pending}"
            raise ProtocolError(f"check of tick {tick}: {awaited} is to be decided")
        self._pending += self._interval

    def limit(self, tick: int) -> int:
        """The last tick up to `tick` that may be granted."""
        return tick if self._pending is None else min(tick, self._pending)
