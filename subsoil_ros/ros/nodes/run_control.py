"""Pause, resume, steps and the end of a run, as requested by its services and its action."""

from collections.abc import Callable
from enum import IntEnum

from ...coupling.exit_status import ExitStatus
from ...coupling.protocol import Coupler
from ...errors import InterruptedRunError, ProtocolError

RESET_ADVICE = (
    "a run is one record in which each tick stands once, so it cannot be reset; end it and start another: "
    "its first tick is the same, bit for bit"
)


class RunState(IntEnum):
    """Values of simulation_interfaces/SimulationState."""

    STOPPED = 0
    PLAYING = 1
    PAUSED = 2
    QUITTING = 3


class Result(IntEnum):
    """Values of simulation_interfaces/Result, and of SetSimulationState's own results."""

    FEATURE_UNSUPPORTED = 0
    OK = 1
    INCORRECT_STATE = 3
    OPERATION_FAILED = 4
    ALREADY_IN_TARGET_STATE = 101


Answer = Callable[[Result, str], None]
"""Called once, now or later, with the result and the reason of a failure in one line."""


class RunControl:
    """Controls a coupler, in the coupler's thread. A pause and steps are answered when the run stands.

    Args:
        changed: called when ticks may be granted again, or when the run begins to pause.
        end: called with a stop request.
    """

    def __init__(
        self, coupler: Coupler, changed: Callable[[], None], end: Callable[[ExitStatus], None]
    ) -> None:
        self._coupler = coupler
        self._changed = changed
        self._end = end
        self._ended = ""  # reason why no request can be served any more
        self.waiting: list[tuple[int, Answer]] = []
        """Ticks to be done, and the answers to those who wait for them."""

    @property
    def done_tick(self) -> int:
        """The last tick that is done."""
        return self._coupler.done_tick

    @property
    def state(self) -> RunState:
        """The state of the run; STOPPED until every node is ready."""
        if self._ended:
            return RunState.QUITTING
        if self._coupler.paused:
            return RunState.PAUSED
        return RunState.PLAYING if self._coupler.ready else RunState.STOPPED

    def pause(self, answer: Answer) -> None:
        """Pause at the end of the granted ticks; steps that would go further end there."""
        if self._refused(answer):
            return
        last = self._coupler.pause()
        waiting, self.waiting = self.waiting, []
        for tick, other in waiting:
            if tick > last:
                other(Result.OPERATION_FAILED, f"paused at the end of tick {last}")
            else:
                self.waiting.append((tick, other))
        self._wait_for(last, answer)
        self.note_done()

    def resume(self, answer: Answer) -> None:
        """End the pause."""
        if self._refused(answer):
            return
        playing = not self._coupler.paused
        answer(Result.ALREADY_IN_TARGET_STATE if playing else Result.OK, "")
        self._coupler.resume()
        self._changed()

    def step(self, count: int, answer: Answer) -> int | None:
        """Let a paused run do `count` more ticks; return the last of them, None if it is refused."""
        if self._refused(answer):
            return None
        try:
            tick = self._coupler.step(count)
        except ProtocolError as error:
            wrong_state = not self._coupler.paused
            answer(Result.INCORRECT_STATE if wrong_state else Result.OPERATION_FAILED, str(error))
            return None
        self._wait_for(tick, answer)
        return tick

    def set_state(self, wanted: int, answer: Answer) -> None:
        """Change to a state of RunState; a run cannot change to STOPPED."""
        if self._refused(answer):
            return
        if wanted == RunState.PLAYING:
            self.resume(answer)
        elif wanted == RunState.PAUSED:
            if self._coupler.standing:
                answer(Result.ALREADY_IN_TARGET_STATE, "")
            else:
                self.pause(answer)
        elif wanted == RunState.QUITTING:
            answer(Result.OK, "")
            self._end(ExitStatus(InterruptedRunError.exit_status, "ended by set_simulation_state: QUITTING"))
        elif wanted == RunState.STOPPED:
            answer(Result.FEATURE_UNSUPPORTED, f"STOPPED would reset: {RESET_ADVICE}")
        else:
            known = ", ".join(f"{state.name} ({state.value})" for state in RunState)
            answer(Result.OPERATION_FAILED, f"state: given {wanted}, allowed are {known}")

    def note_done(self) -> None:
        """Answer the requests whose ticks are done now."""
        done = self._coupler.done_tick
        waiting, self.waiting = self.waiting, []
        for tick, answer in waiting:
            if tick > done:
                self.waiting.append((tick, answer))
            else:
                answer(Result.OK, "")

    def refuse_waiting(self, reason: str) -> None:
        """Answer all waiting requests with the reason why the run has ended."""
        self._ended = reason
        waiting, self.waiting = self.waiting, []
        for _, answer in waiting:
            answer(Result.OPERATION_FAILED, reason)

    def _refused(self, answer: Answer) -> bool:
        """Answer that the run has ended, if it has; return whether it has."""
        if self._ended:
            answer(Result.OPERATION_FAILED, self._ended)
        return bool(self._ended)

    def _wait_for(self, tick: int, answer: Answer) -> None:
        self.waiting.append((tick, answer))
        self._changed()
