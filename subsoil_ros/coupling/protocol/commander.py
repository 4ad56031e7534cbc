"""The controller's side: one command per control tick, from the states at series ticks."""

from ...messages import Command, Grant, MechanismState
from ...schedule import Schedule
from ...ticks import INITIAL_TICK
from .streams import Stream


class Commander:
    """Accepts the mechanism's states, each once and in order, and returns the ticks that need a command.

    The command of tick k follows from the state after tick k - 1. In a resumed run whose first tick needs
    one, the state before that tick comes first. The state of INITIAL_TICK needs no command.
    """

    def __init__(self, run_id: str, schedule: Schedule) -> None:
        self.abort: Grant | None = None
        self._schedule = schedule
        self._run_id = run_id
        every = schedule.series_ticks
        first = schedule.first_tick // every * every + every - 1
        if schedule.control_due(schedule.first_tick):
            first = schedule.first_tick - 1
        self._states = Stream("mechanism_state", run_id, schedule, first, every)

    def accept_state(self, state: MechanismState) -> int | None:
        """Accept a state; return the tick that needs a command now, or None.

        Raises:
            ProtocolError: it is of another run, or not of the expected tick.
        """
        schedule = self._schedule
        beside = state.tick in (INITIAL_TICK, schedule.last_tick)  # before the run, or at its end
        if beside and state.tick != self._states.next_tick:
            self._states.refuse_foreign(state.run_id, state.tick)
            return None
        self._states.accept(state.run_id, state.tick)
        tick = state.tick + 1
        return tick if schedule.control_due(tick) and tick <= schedule.last_tick else None

    def accept_grant(self, grant: Grant) -> None:
        """Accept a grant; only an abort has an effect."""
        if grant.command is Command.ABORT and grant.run_id == self._run_id:
            self.abort = self.abort or grant

    def is_last(self, tick: int) -> bool:
        """Whether no command follows that of `tick`."""
        return self._schedule.next_control(tick + 1) > self._schedule.last_tick
