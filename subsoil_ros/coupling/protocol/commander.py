"""The controller's side: one command per control tick, from the states at series ticks."""

from ...messages import Command, Grant, MechanismState
from ...ticks import INITIAL_TICK, is_control_tick
from .streams import Stream


class Commander:
    """Accepts the mechanism's states, each once and in order, and returns the ticks that need a command.

    Args:
        series_ticks: interval of the states, in ticks; the last tick has one, too.
        control_ticks: a multiple of it; the command of tick k follows from the state after tick k - 1.
        first_tick: later than 0 in a resumed run. If a command is due there, the state before it comes first.
            The state of INITIAL_TICK needs no command.
    """

    def __init__(
        self, run_id: str, tick_count: int, series_ticks: int, control_ticks: int, first_tick: int = 0
    ) -> None:
        self.abort: Grant | None = None
        self._last_tick = tick_count - 1
        self._last_command = self._last_tick // control_ticks * control_ticks
        self._control_ticks = control_ticks
        self._run_id = run_id
        first = first_tick // series_ticks * series_ticks + series_ticks - 1
        if is_control_tick(first_tick, control_ticks):
            first = first_tick - 1
        self._states = Stream("mechanism_state", run_id, tick_count, first, series_ticks)

    def accept_state(self, state: MechanismState) -> int | None:
        """Accept a state; return the tick that needs a command now, or None.

        Raises:
            ProtocolError: it is of another run, or not of the expected tick.
        """
        beside = state.tick in (INITIAL_TICK, self._last_tick)  # before the run, or at its end
        if beside and state.tick != self._states.next_tick:
            self._states.refuse_foreign(state.run_id, state.tick)
            return None
        self._states.accept(state.run_id, state.tick)
        tick = state.tick + 1
        return tick if is_control_tick(tick, self._control_ticks) and tick <= self._last_tick else None

    def accept_grant(self, grant: Grant) -> None:
        """Accept a grant; only an abort has an effect."""
        if grant.command is Command.ABORT and grant.run_id == self._run_id:
            self.abort = self.abort or grant

    def is_last(self, tick: int) -> bool:
        """Whether no command follows that of `tick`."""
        return tick == self._last_command
