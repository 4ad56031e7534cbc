"""Check ticks, at whose end it is decided whether the run ends with the next tick."""

from ...errors import ProtocolError
from ...ticks import is_early_end


class Checks:
    """Limit of the grants: no tick beyond a check tick is granted before its decision.

    Args:
        check_ticks: interval of the ticks with which a run may end early, each after a check tick; 0: none.
        first_tick: first tick of the run; the tick before it may be a check tick, too.
    """

    def __init__(self, check_ticks: int, first_tick: int) -> None:
        self._check_ticks = check_ticks
        end_tick = max(first_tick, 1)  # a check tick comes before every early end
        if check_ticks:
            end_tick = -(-(end_tick + 1) // check_ticks) * check_ticks - 1
        self._pending = end_tick - 1

    def decide(self, tick: int) -> None:
        """Note that the decision of check tick `tick` is made.

        Raises:
            ProtocolError: another check tick, or none, is to be decided.
        """
        if not self._check_ticks or tick != self._pending:
            awaited = f"tick {self._pending}" if self._check_ticks else "no tick"
            raise ProtocolError(f"check of tick {tick}: {awaited} is to be decided")
        self._pending += self._check_ticks

    def limit(self, tick: int) -> int:
        """The last tick up to `tick` that may be granted."""
        return min(tick, self._pending) if self._check_ticks else tick


def is_end(tick: int, last_tick: int, check_ticks: int) -> bool:
    """Whether END may come with `tick`."""
    return tick == last_tick or (tick < last_tick and is_early_end(tick, check_ticks))
