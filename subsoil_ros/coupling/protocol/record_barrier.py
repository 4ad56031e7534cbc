"""The recorder's side: collects the messages of each tick, and returns whole ticks in order."""

from collections.abc import Callable
from typing import Generic, TypeVar

from ...errors import ProtocolError
from ...schedule import Schedule
from ...ticks import INITIAL_TICK
from .handshake import ACK_EVERY_TICKS

Payload = TypeVar("Payload")


class RecordBarrier(Generic[Payload]):
    """The recorder's side: collects the messages of each tick, and returns whole ticks in order.

    An abort names the last tick that the coupler has finished; other nodes may be ahead of it. So a tick is
    returned only when no abort can name an earlier one any more.

    Args:
        schedule: that of the run; the attribute ends with an earlier tick once END has come with it.
        due: names of the messages due at a tick, in the order in which they are recorded.
        grant_window: a grant of tick k means that the coupler has finished tick k - grant_window.
        due_at_end: as `due`, if the run ends with the tick; default: `due`. The grant is among them.
        initial: names of the messages of INITIAL_TICK, the state before tick 0; empty in a resumed run.
    """

    def __init__(
        self,
        schedule: Schedule,
        due: Callable[[int], tuple[str, ...]],
        grant_window: int,
        *,
        due_at_end: Callable[[int], tuple[str, ...]] | None = None,
        initial: tuple[str, ...] = (),
    ) -> None:
        first_tick = schedule.first_tick
        self.schedule = schedule
        self.done_tick = INITIAL_TICK - 1 if initial else first_tick - 1
        self._window = grant_window
        self._certain = first_tick - 1  # no abort names an earlier tick
        self.cut_tick = self.last_tick  # the record ends here; earlier after an abort
        self._acknowledged = first_tick - 1
        self._due_before_end = due
        self._due_at_end = due_at_end or due
        self._initial = initial
        self._granted = False
        self._kept: dict[int, dict[str, Payload]] = {}

    @property
    def last_tick(self) -> int:
        """The tick the run ends with, as far as is known."""
        return self.schedule.last_tick

    def add(self, name: str, tick: int, payload: Payload) -> None:
        """Keep a message.

        Raises:
            ProtocolError: it is repeated, or not due at its tick.
        """
        allowed = self._due(tick)
        if self.schedule.may_end(tick):
            allowed = self._due_at_end(tick)  # its grant may be on the way
        if name not in allowed or tick > self.last_tick:
            raise ProtocolError(f"{name}: tick {tick} came, nothing of it is due then")
        kept = self._kept.setdefault(tick, {})
        if tick <= self.done_tick or name in kept:
            raise ProtocolError(
                f"{name}: tick {tick} is repeated, the record stands at tick {self.done_tick}"
            )
        kept[name] = payload

    def end(self, tick: int) -> None:
        """Handle END, which came with `tick`.

        Raises:
            ProtocolError: the run may not end there.
        """
        if not self.schedule.may_end(tick):
            raise ProtocolError(f"grant: END came with tick {tick}, the last tick is {self.last_tick}")
        self.schedule = self.schedule.ends_with(tick)
        self.cut_tick = min(self.cut_tick, tick)

    def note_grant(self, tick: int) -> None:
        """Note that `tick` is granted."""
        self._granted = True
        self.note_finished(tick - self._window)

    def note_finished(self, tick: int) -> None:
        """Note that the coupler has finished `tick`: no abort names an earlier one from now on."""
        self._certain = max(tick, self._certain)

    def cut(self, tick: int) -> None:
        """End the record with `tick`, which an abort names; if the run never began, at once."""
        began = self._granted or tick > INITIAL_TICK
        self.cut_tick = min(tick if began else self.done_tick, self.cut_tick)
        self.note_finished(tick)

    def take_tick(self) -> tuple[int, list[tuple[str, Payload]]] | None:
        """The next complete tick, its messages in recording order; None while one is missing."""
        tick = self.done_tick + 1
        kept = self._kept.get(tick, {})
        due = self._due(tick)
        if tick > min(self.cut_tick, self._certain) or not all(name in kept for name in due):
            return None
        if len(kept) > len(due):
            more = ", ".join(name for name in kept if name not in due)
            raise ProtocolError(f"{more}: tick {tick} came, nothing of it is due then")
        del self._kept[tick]
        self.done_tick = tick
        return tick, [(name, kept[name]) for name in due]

    def next_ack(self, *, at_once: bool = False) -> int | None:
        """The tick to acknowledge now: after ACK_EVERY_TICKS, at the end, or `at_once`; else None."""
        at_once = at_once or self.done_tick == self.last_tick
        if self.done_tick < self._acknowledged + ACK_EVERY_TICKS and not at_once:
            return None
        if self.done_tick == self._acknowledged:
            return None
        self._acknowledged = self.done_tick
        return self.done_tick

    @property
    def finished(self) -> bool:
        """Whether the record is complete up to its cut."""
        return self.done_tick >= self.cut_tick

    def missing(self) -> str:
        """Messages that the next tick waits for, in words."""
        tick = self.done_tick + 1
        kept = self._kept.get(tick, {})
        return f"tick {tick}: {', '.join(name for name in self._due(tick) if name not in kept)}"

    def _due(self, tick: int) -> tuple[str, ...]:
        """Names of the messages due at `tick`; those of a last tick only once its END has come."""
        if tick == INITIAL_TICK:
            return self._initial
        return (self._due_at_end if tick == self.last_tick else self._due_before_end)(tick)
