"""The coupler's side: grants ticks within their limits, tracks their completion, ends the run."""

from collections.abc import Mapping
from dataclasses import dataclass

from ...errors import InputError, ProtocolError, RunError
from ...messages import (
    Command,
    DriverCommand,
    Grant,
    NodeState,
    NodeStatus,
    TickAck,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from ...schedule import Schedule
from ...ticks import INITIAL_TICK
from .handshake import ACK_LAG_TICKS, CONTROLLER, RECORDER, SOIL, check_node_status
from .participant import AnswerStream, CommandStream, Stream, refuse_other_tools


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


@dataclass(frozen=True)
class FinishedTick:
    """A tick that motion and soil have both finished."""

    tick: int
    motions: tuple[ToolMotion, ...]
    wrenches: tuple[ToolWrench, ...]


class Coupler:
    """Grants ticks, tracks their completion, ends the run.

    Args:
        names: names of the participants that must be ready before the first tick; with a soil, wrenches are
            part of a tick.
        schedule: that of the run; the attribute ends with an earlier tick once that is decided. No tick
            beyond a check tick is granted before `decide`.
        needed: capabilities that each node must have (handshake.needed_capabilities).
        paused: no tick is granted before `resume` or `step`.
    """

    def __init__(
        self,
        node_status: NodeStatus,
        names: tuple[str, ...],
        tools: tuple[str, ...],
        schedule: Schedule,
        grant_window: int,
        *,
        needed: Mapping[str, Mapping[str, str]] | None = None,
        paused: bool = False,
    ) -> None:
        before = schedule.first_tick - 1
        self.schedule = schedule
        self.done_tick = before
        self.acknowledged_tick = before if RECORDER in names else schedule.last_tick
        self.abort_grant: Grant | None = None
        self.initial_motions: tuple[ToolMotion, ...] = ()
        self.initial_wrenches: tuple[ToolWrench, ...] = ()
        self._own = node_status
        self._tools = tools
        self._window = grant_window
        self._soil = SOIL in names
        self._granted = before
        self._holding = False
        self._waiting = set(names)
        self._names = names
        self._process_ids: dict[str, int] = {}
        self._needed = needed or {}
        self._pacing = Pacing(before if paused else None)
        self._checks = Checks(schedule)
        run_id = node_status.run_id
        self._acks = Stream("tick_ack", run_id, schedule, first=0)
        self._statuses = Stream("node_status", run_id, schedule, first=0)
        self._motions = AnswerStream[ToolMotions]("tool_motions", run_id, schedule, tools)
        self._wrenches = AnswerStream[ToolWrenches]("tool_wrenches", run_id, schedule, tools)
        self._commands = CommandStream(run_id, schedule)

    @property
    def last_tick(self) -> int:
        """The tick the run ends with, as far as is decided."""
        return self.schedule.last_tick

    @property
    def ready(self) -> bool:
        """Whether every participant is ready and tick 0 can be granted."""
        return not self._waiting

    @property
    def finished(self) -> bool:
        """Whether every tick is done and recorded."""
        return self.acknowledged_tick >= self.last_tick == self.done_tick

    def accept_node_status(self, node_status: NodeStatus) -> None:
        """Accept the status of a participant.

        Raises:
            RunError, InputError: the participant reports a fault.
            ProtocolError: it is of another run, does not match (handshake), or two nodes have its name.
        """
        if node_status.node not in self._names:
            return
        self._statuses.refuse_other_run(node_status.run_id, node_status.tick)
        known = self._process_ids.setdefault(node_status.node, node_status.process_id)
        if known != node_status.process_id:
            raise ProtocolError(
                f"node_status: two nodes '{node_status.node}', processes {known} and {node_status.process_id}"
            )
        if node_status.state is NodeState.FAULT:
            bad_input = node_status.exit_status == InputError.exit_status
            raise (InputError if bad_input else RunError)(f"{node_status.node}: {node_status.message}")
        check_node_status(self._own, node_status, self._needed.get(node_status.node, {}))
        if node_status.state is not NodeState.READY or node_status.node not in self._waiting:
            return
        if node_status.initial_motions:
            given_tools = tuple(t.tool for t in node_status.initial_motions)
            refuse_other_tools("node_status", INITIAL_TICK, given_tools, self._tools)
            self.initial_motions = node_status.initial_motions
        if node_status.node == SOIL:
            given_tools = tuple(t.tool for t in node_status.initial_wrenches)
            refuse_other_tools("node_status", INITIAL_TICK, given_tools, self._tools)
            self.initial_wrenches = node_status.initial_wrenches
        self._waiting.discard(node_status.node)

    def next_grants(self, ahead: int | None = None) -> tuple[Grant, ...]:
        """The grants that can be given now, each once; none before all are ready.

        ahead: ticks to grant beyond the last finished one, at most the grant window, the default.
        """
        if not self.ready or self.abort_grant or self._holding:
            return ()
        first = self._granted + 1
        window = self._window if ahead is None else min(ahead, self._window)
        free = min(self.done_tick + window, self.acknowledged_tick + ACK_LAG_TICKS, self.last_tick)
        self._granted = self._pacing.limit(self._checks.limit(max(free, self._granted)))
        return tuple(
            Grant(self._own.run_id, tick, Command.END if tick == self.last_tick else Command.RUN)
            for tick in range(first, self._granted + 1)
        )

    def decide(self, tick: int, *, ends: bool) -> None:
        """Continue after check tick `tick`, which is done, or end the run with the tick after it.

        Raises:
            ProtocolError: it is not done, or its decision is not due.
        """
        if tick != self.done_tick:
            raise ProtocolError(f"check of tick {tick}: done is tick {self.done_tick}")
        self._checks.decide(tick)
        if ends:
            self.schedule = self.schedule.ends_with(tick + 1)

    @property
    def paused(self) -> bool:
        """Whether the run is paused: only ticks granted before the pause, or asked for as steps, are done."""
        return self._pacing.paused

    @property
    def standing(self) -> bool:
        """Whether a paused run has nothing to wait for: all ticks that may be granted are done."""
        hold = self._pacing.hold_tick
        return self.ready and hold is not None and hold <= self.done_tick and hold < self.last_tick

    def pause(self) -> int:
        """Grant no more ticks; return the tick at whose end the run will stand."""
        return self._pacing.pause(self._granted)

    def resume(self) -> None:
        """Grant ticks as before the pause; no effect if the run is not paused."""
        self._pacing.resume()

    def step(self, count: int) -> int:
        """Grant `count` more ticks to a paused run; return the last of them.

        Raises:
            ProtocolError: the run is not paused, has no tick left, or count is below 1.
        """
        return self._pacing.step(count, self.last_tick)

    def accept_motions(self, motions: ToolMotions) -> None:
        """Accept the motions of a tick."""
        self._refuse_ungranted("tool_motions", motions.tick)
        self._motions.add(motions)

    def accept_wrenches(self, wrenches: ToolWrenches) -> None:
        """Accept the wrenches of a tick."""
        self._refuse_ungranted("tool_wrenches", wrenches.tick)
        self._wrenches.add(wrenches)

    def accept_command(self, command: DriverCommand) -> None:
        """Accept the command of a control tick, which may come as soon as the tick before it is done."""
        self._commands.add(command)
        self._refuse_ungranted("driver_command", command.tick, ahead=1)

    def accept_ack(self, ack: TickAck) -> None:
        """Accept the recorder's acknowledgement that everything up to a tick is written."""
        self._acks.refuse_other_run(ack.run_id, ack.tick)
        self._refuse_ungranted("tick_ack", ack.tick)
        if ack.tick <= self.acknowledged_tick:
            raise ProtocolError(f"tick_ack: tick {ack.tick} came after tick {self.acknowledged_tick}")
        self.acknowledged_tick = ack.tick

    def take_finished(self) -> FinishedTick | None:
        """The next tick that all have finished, once, in order; None while a message is missing."""
        if not self._motions or (self._soil and not self._wrenches):
            return None
        if self.schedule.control_due(self.done_tick + 1):
            if not self._commands.has(self.done_tick + 1):
                return None
            self._commands.take()
        motions = self._motions.take()
        wrenches = self._wrenches.take().tools if self._soil else ()
        self.done_tick = motions.tick
        return FinishedTick(motions.tick, motions.tools, wrenches)

    def abort(self, reason: str) -> Grant:
        """End the run at the last finished tick; the first reason is kept."""
        if self.abort_grant is None:
            self.abort_grant = Grant(self._own.run_id, self.done_tick, Command.ABORT, reason)
        return self.abort_grant

    def hold(self) -> None:
        """Stop granting ticks."""
        self._holding = True

    def keep(self) -> Grant | None:
        """The CHECKPOINT grant, once all granted ticks are done; None before.

        Raises:
            ProtocolError: `hold` was not called before.
        """
        if not self._holding:
            raise ProtocolError("grant: CHECKPOINT while ticks are being granted")
        if self.done_tick < self._granted:
            return None
        return Grant(self._own.run_id, self.done_tick, Command.CHECKPOINT)

    def missing(self) -> str:
        """Message that the run waits for, in words."""
        if self._waiting:
            return f"ready from {', '.join(sorted(self._waiting))}"
        tick = self.done_tick + 1
        controlled = tick <= self._granted and self.schedule.control_due(tick)
        if controlled and not self._commands.has(tick):
            return f"driver_command of tick {tick} from {CONTROLLER}"
        if not self._motions and self.done_tick < self._granted:
            return f"tool_motions of tick {self.done_tick + 1}"
        if self._soil and not self._wrenches and self.done_tick < self._granted:
            return f"tool_wrenches of tick {self.done_tick + 1}"
        return f"tick_ack after tick {self.acknowledged_tick} from {RECORDER}"

    def _refuse_ungranted(self, name: str, tick: int, ahead: int = 0) -> None:
        if tick > self._granted + ahead:
            raise ProtocolError(f"{name}: tick {tick} came, granted is tick {self._granted}")
