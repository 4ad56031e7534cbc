"""Pause, resume and single steps: the limit that they set for grants."""

from dataclasses import dataclass

from ...errors import ProtocolError


@dataclass
class Pacing:
    """The last tick that may be granted while the run is paused; None while it is not.

    Ticks granted before the pause are still done: the run then stands at the end of a tick.
    """

    hold_tick: int | None = None

    @property
    def paused(self) -> bool:
        """Whether the run stands, or will stand when the granted ticks are done."""
        return self.hold_tick is not None

    def pause(self, granted: int) -> int:
        """Stop after the granted ticks; return the tick at whose end the run stands."""
        self.hold_tick = granted
        return granted

    def resume(self) -> None:
        """End the pause."""
        self.hold_tick = None

    def step(self, count: int, last_tick: int) -> int:
        """Allow `count` more ticks, then stand again; return the last of them.

        Raises:
            ProtocolError: the run is not paused, has no tick left, or count is below 1.
        """
        if self.hold_tick is None:
            raise ProtocolError("step: the run is not paused; pause it first")
        if count < 1:
            raise ProtocolError(f"step: {count} steps asked for; give 1 or more")
        if self.hold_tick >= last_tick:
            raise ProtocolError(f"step: the run ends with tick {last_tick}, no tick is left")
        self.hold_tick = min(self.hold_tick + count, last_tick)
        return self.hold_tick

    def limit(self, tick: int) -> int:
        """The last tick up to `tick` that may be granted."""
        return tick if self.hold_tick is None else min(tick, self.hold_tick)
