"""Motion, soil and controller: they accept messages in any interleaving, and do each tick once, in order.

Streams, which the coupler has too, hold the ticks of one kind of message: all of one run, each exactly once.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from ...errors import ProtocolError
from ...messages import (
    Command,
    DriverCommand,
    Grant,
    MechanismState,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from ...schedule import Schedule
from ...ticks import INITIAL_TICK

Answer = TypeVar("Answer", ToolMotions, ToolWrenches)


class Stream:
    """The ticks of one kind of message: all of one run, each exactly once, in order.

    Ticks are `first`, by default the first one of the run, `first` + `every`, and so on.
    """

    def __init__(
        self, name: str, run_id: str, schedule: Schedule, first: int | None = None, every: int = 1
    ) -> None:
        self.next_tick = schedule.first_tick if first is None else first
        self._every = every
        self._name = name
        self._run_id = run_id
        self._last_tick = schedule.last_tick

    def accept(self, run_id: str, tick: int) -> None:
        """Accept the next message.

        Raises:
            ProtocolError: it is of another run, or not of the expected tick.
        """
        self.refuse_other_run(run_id, tick)
        if tick != self.next_tick:
            what = (
                "repeated" if tick < self.next_tick else f"{(tick - self.next_tick) // self._every} missing"
            )
            if (tick - self.next_tick) % self._every:
                what = f"one is due every {self._every} ticks"
            raise ProtocolError(f"{self._name}: tick {tick} came where tick {self.next_tick} is due ({what})")
        if tick > self._last_tick:
            raise ProtocolError(
                f"{self._name}: tick {tick} came, but the run ends with tick {self._last_tick}"
            )
        self.next_tick += self._every

    def refuse_other_run(self, run_id: str, tick: int) -> None:
        """Raises ProtocolError if a message of `tick` is of another run."""
        if run_id != self._run_id:
            raise ProtocolError(
                f"{self._name}: tick {tick} is of run '{run_id}', this is run '{self._run_id}', at tick "
                f"{self.next_tick}; give every run a ROS_DOMAIN_ID of its own"
            )


def refuse_other_tools(name: str, tick: int, given: tuple[str, ...], tools: tuple[str, ...]) -> None:
    if given != tools:
        raise ProtocolError(f"{name}: tick {tick} has tools {list(given)}, the scene has {list(tools)}")


class AnswerStream(Stream, Generic[Answer]):
    """Motions or wrenches, kept until `take` returns them in order."""

    def __init__(self, name: str, run_id: str, schedule: Schedule, tools: tuple[str, ...]) -> None:
        super().__init__(name, run_id, schedule)
        self._tools = tools
        self._kept: deque[Answer] = deque()

    def add(self, answer: Answer) -> None:
        """Keep the next message. Raises ProtocolError if it is not the next, or has other tools."""
        self.accept(answer.run_id, answer.tick)
        refuse_other_tools(self._name, answer.tick, tuple(t.tool for t in answer.tools), self._tools)
        self._kept.append(answer)

    def __len__(self) -> int:
        return len(self._kept)

    def take(self) -> Answer:
        """Remove and return the oldest message kept."""
        return self._kept.popleft()


class CommandStream(Stream):
    """Commands of a controller, at the control ticks of the run."""

    def __init__(self, run_id: str, schedule: Schedule) -> None:
        first = schedule.next_control(schedule.first_tick)
        super().__init__("driver_command", run_id, schedule, first, schedule.control_ticks)
        self._controlled = schedule.control_ticks > 0
        self._kept: deque[DriverCommand] = deque()

    def add(self, command: DriverCommand) -> None:
        """Keep the next command. Raises ProtocolError if it is not the next."""
        if not self._controlled:
            raise ProtocolError(f"driver_command: tick {command.tick} came, but the scene has no controller")
        self.accept(command.run_id, command.tick)
        self._kept.append(command)

    def has(self, tick: int) -> bool:
        """Whether the command of `tick` has come."""
        return bool(self._kept) and self._kept[0].tick == tick

    def take(self) -> DriverCommand:
        """Remove and return the oldest command kept."""
        return self._kept.popleft()


class Needs(Enum):
    """Message that a participant needs to advance tick k, beside its grant."""

    NOTHING = "nothing"  # a mechanism without soil, a soil that moves its tools itself
    WRENCHES = "wrenches of tick k-1"
    MOTIONS = "motions of tick k"


@dataclass(frozen=True)
class Work:
    """A tick that can be advanced now, with the messages it needs."""

    tick: int
    motions: tuple[ToolMotion, ...] = ()
    wrenches: tuple[ToolWrench, ...] = ()
    command: DriverCommand | None = None  # in force from the start of the tick


class Participant:
    """Motion or soil: accepts messages in any interleaving, and returns each tick once, in order.

    Args:
        schedule: that of the run; the attribute ends with an earlier tick once END has come with it.
        commanded: whether control ticks need the controller's command.
    """

    def __init__(
        self,
        run_id: str,
        schedule: Schedule,
        needs: Needs,
        tools: tuple[str, ...],
        *,
        commanded: bool = False,
    ) -> None:
        self.schedule = schedule
        self.done_tick = schedule.first_tick - 1  # last tick handed out and finished
        self.abort: Grant | None = None
        self._needs = needs
        self._commanded = commanded
        self._grants = Stream("grant", run_id, schedule)
        self._motions = AnswerStream[ToolMotions]("tool_motions", run_id, schedule, tools)
        self._wrenches = AnswerStream[ToolWrenches]("tool_wrenches", run_id, schedule, tools)
        self._commands = CommandStream(run_id, schedule)
        self._initial_wrenches: tuple[ToolWrench, ...] | None = None
        self._at_work = False
        self._ended = False

    @property
    def last_tick(self) -> int:
        """The tick the run ends with, as far as is known."""
        return self.schedule.last_tick

    def start(self, wrenches: tuple[ToolWrench, ...]) -> None:
        """Accept the wrenches before the first tick; only Needs.WRENCHES uses them."""
        self._initial_wrenches = wrenches

    def accept_grant(self, grant: Grant) -> None:
        """Accept a grant. ABORT may come at any time; no tick is returned after it."""
        if grant.command is Command.ABORT:
            self._grants.refuse_other_run(grant.run_id, grant.tick)
            self.abort = self.abort or grant
            return
        if self._ended and grant.tick > self.last_tick:
            raise ProtocolError(
                f"grant: tick {grant.tick} came, but the run ends with tick {self.last_tick}, by its END"
            )
        self._grants.accept(grant.run_id, grant.tick)
        end, schedule = grant.command is Command.END, self.schedule
        allowed = schedule.may_end(grant.tick) if end else grant.tick < schedule.last_tick
        if not allowed:
            every = f"; END may come every {schedule.check_ticks} ticks" if schedule.check_ticks else ""
            raise ProtocolError(
                f"grant: {grant.command.name} came with tick {grant.tick}, the last tick is "
                f"{self.last_tick}{every}"
            )
        if end:
            self.schedule, self._ended = schedule.ends_with(grant.tick), True

    def accept_keep(self, grant: Grant) -> None:
        """Handle CHECKPOINT: verify that this participant has finished exactly that tick.

        Raises:
            ProtocolError: it has not, or a later tick is granted.
        """
        self._grants.refuse_other_run(grant.run_id, grant.tick)
        if self._at_work or grant.tick != self.done_tick or self._grants.next_tick != grant.tick + 1:
            raise ProtocolError(
                f"grant: CHECKPOINT came for tick {grant.tick}, done is tick {self.done_tick}, granted tick "
                f"{self._grants.next_tick - 1}"
            )

    def accept_motions(self, motions: ToolMotions) -> None:
        """Accept the motions of a tick."""
        self._motions.add(motions)

    def accept_wrenches(self, wrenches: ToolWrenches) -> None:
        """Accept the wrenches of a tick."""
        self._wrenches.add(wrenches)

    def accept_command(self, command: DriverCommand) -> None:
        """Accept the command of a control tick."""
        self._commands.add(command)

    def next_work(self) -> Work | None:
        """The next tick with the messages it needs, once; None while one is missing.

        The caller advances the tick and calls `finish` before the next call.
        """
        tick = self.done_tick + 1
        if self._at_work or self.abort or tick >= self._grants.next_tick or tick > self.last_tick:
            return None
        first = tick == self.schedule.first_tick
        controlled = self._commanded and self.schedule.control_due(tick)
        if controlled and not self._commands.has(tick):
            return None
        motions: tuple[ToolMotion, ...] | None = ()
        wrenches: tuple[ToolWrench, ...] | None = ()
        if self._needs is Needs.MOTIONS:
            motions = self._motions.take().tools if self._motions else None
        elif self._needs is Needs.WRENCHES and not first:
            wrenches = self._wrenches.take().tools if self._wrenches else None
        elif self._needs is Needs.WRENCHES:
            wrenches = self._initial_wrenches
        if motions is None or wrenches is None:
            return None
        self._at_work = True
        return Work(tick, motions, wrenches, self._commands.take() if controlled else None)

    def finish(self, tick: int) -> None:
        """Note that the tick returned last is advanced."""
        if not self._at_work or tick != self.done_tick + 1:
            raise ProtocolError(f"tick {tick} is finished where tick {self.done_tick + 1} is at work")
        self._at_work = False
        self.done_tick = tick

    @property
    def waits_for_grant(self) -> bool:
        """Whether every tick granted so far is done."""
        return self.done_tick + 1 >= self._grants.next_tick

    @property
    def finished(self) -> bool:
        """Whether the last tick is done."""
        return self.done_tick == self.last_tick


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
            self._states.refuse_other_run(state.run_id, state.tick)
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
