"""The coupler's side: grants ticks, follows their completion, ends the run."""

from dataclasses import dataclass

from ...errors import ProtocolError, RunError
from ...messages import (
    Command,
    Grant,
    NodeHello,
    NodeState,
    TickAck,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from ...ticks import INITIAL_TICK
from .names import ACK_LAG_TICKS, RECORDER, SOIL
from .streams import AnswerStream, Stream, refuse_other_tools


@dataclass(frozen=True)
class FinishedTick:
    """A tick that mover and soil have both finished."""

    tick: int
    motions: tuple[ToolMotion, ...]
    wrenches: tuple[ToolWrench, ...]


class Coupler:
    """Grants ticks, follows their completion, ends the run.

    Args:
        names: of the participants that must be ready before tick 0.
        soil: whether wrenches are part of a tick.
        first_tick: later than 0 where the run goes on from another.
    """

    def __init__(
        self,
        hello: NodeHello,
        names: tuple[str, ...],
        tools: tuple[str, ...],
        tick_count: int,
        grant_window: int,
        soil: bool,
        first_tick: int = 0,
    ) -> None:
        self.last_tick = tick_count - 1
        self.done_tick = first_tick - 1
        self.acknowledged_tick = first_tick - 1
        self.abort_grant: Grant | None = None
        self.initial_motions: tuple[ToolMotion, ...] = ()
        self.initial_wrenches: tuple[ToolWrench, ...] = ()
        self._own = hello
        self._tools = tools
        self._window = grant_window
        self._soil = soil
        self._granted = first_tick - 1
        self._holding = False
        self._waiting = set(names)
        self._names = names
        self._process_ids: dict[str, int] = {}
        run_id = hello.run_id
        self._acks = Stream("tick_ack", run_id, tick_count)
        self._motions = AnswerStream[ToolMotions]("tool_motions", run_id, tick_count, tools, first_tick)
        self._wrenches = AnswerStream[ToolWrenches]("tool_wrenches", run_id, tick_count, tools, first_tick)

    @property
    def ready(self) -> bool:
        """Whether every participant is ready and tick 0 can be granted."""
        return not self._waiting

    @property
    def finished(self) -> bool:
        """Whether every tick is done and recorded."""
        return self.acknowledged_tick == self.last_tick == self.done_tick

    def accept_hello(self, hello: NodeHello) -> None:
        """Takes the hello or heartbeat of a participant.

        Raises:
            RunError: the participant reports a fault.
            ProtocolError: it is of another run, scene or version, or there are two of its name.
        """
        if hello.node not in self._names:
            return
        self._acks.refuse_foreign(hello.run_id, hello.tick)
        known = self._process_ids.setdefault(hello.node, hello.process_id)
        if known != hello.process_id:
            raise ProtocolError(
                f"node_hello: two nodes '{hello.node}', processes {known} and {hello.process_id}"
            )
        if hello.state is NodeState.FAULT:
            raise RunError(f"{hello.node}: {hello.message}")
        for key, own, given in (
            ("scene", self._own.scene_hash, hello.scene_hash),
            ("version", self._own.package_version, hello.package_version),
        ):
            if own != given:
                raise ProtocolError(
                    f"node_hello: {hello.node} runs {key} {given}, the coupler {own}; start all nodes alike"
                )
        if hello.state is not NodeState.READY or hello.node not in self._waiting:
            return
        if hello.initial_motions:
            given_tools = tuple(t.tool for t in hello.initial_motions)
            refuse_other_tools("node_hello", INITIAL_TICK, given_tools, self._tools)
            self.initial_motions = hello.initial_motions
        if hello.node == SOIL:
            given_tools = tuple(t.tool for t in hello.initial_wrenches)
            refuse_other_tools("node_hello", INITIAL_TICK, given_tools, self._tools)
            self.initial_wrenches = hello.initial_wrenches
        self._waiting.discard(hello.node)

    def next_grants(self) -> tuple[Grant, ...]:
        """The grants that can be given now, each once; none before everybody is ready."""
        if not self.ready or self.abort_grant or self._holding:
            return ()
        first = self._granted + 1
        self._granted = min(
            self.done_tick + self._window, self.acknowledged_tick + ACK_LAG_TICKS, self.last_tick
        )
        return tuple(
            Grant(self._own.run_id, tick, Command.END if tick == self.last_tick else Command.RUN)
            for tick in range(first, self._granted + 1)
        )

    def accept_motions(self, motions: ToolMotions) -> None:
        """Takes the motions of a tick."""
        self._refuse_ungranted("tool_motions", motions.tick)
        self._motions.add(motions)

    def accept_wrenches(self, wrenches: ToolWrenches) -> None:
        """Takes the wrenches of a tick."""
        self._refuse_ungranted("tool_wrenches", wrenches.tick)
        self._wrenches.add(wrenches)

    def accept_ack(self, ack: TickAck) -> None:
        """Takes the recorder's word that everything up to a tick is written."""
        self._acks.refuse_foreign(ack.run_id, ack.tick)
        self._refuse_ungranted("tick_ack", ack.tick)
        if ack.tick <= self.acknowledged_tick:
            raise ProtocolError(f"tick_ack: tick {ack.tick} came after tick {self.acknowledged_tick}")
        self.acknowledged_tick = ack.tick

    def take_finished(self) -> FinishedTick | None:
        """The next tick that all have finished, once, in order; None while something is missing."""
        if not self._motions or (self._soil and not self._wrenches):
            return None
        motions = self._motions.take()
        wrenches = self._wrenches.take().tools if self._soil else ()
        self.done_tick = motions.tick
        return FinishedTick(motions.tick, motions.tools, wrenches)

    def abort(self, reason: str) -> Grant:
        """Ends the run at the last finished tick; the first reason stands."""
        if self.abort_grant is None:
            self.abort_grant = Grant(self._own.run_id, self.done_tick, Command.ABORT, reason)
        return self.abort_grant

    def hold(self) -> None:
        """Gives no more grants."""
        self._holding = True

    def keep(self) -> Grant | None:
        """The word to write a checkpoint, once all that was granted is done; None before.

        Raises:
            ProtocolError: grants are not held back.
        """
        if not self._holding:
            raise ProtocolError("grant: KEEP while ticks are being granted")
        if self.done_tick < self._granted:
            return None
        return Grant(self._own.run_id, self.done_tick, Command.KEEP)

    def missing(self) -> str:
        """What the run waits for, in words."""
        if self._waiting:
            return f"ready from {', '.join(sorted(self._waiting))}"
        if not self._motions and self.done_tick < self._granted:
            return f"tool_motions of tick {self.done_tick + 1}"
        if self._soil and not self._wrenches and self.done_tick < self._granted:
            return f"tool_wrenches of tick {self.done_tick + 1}"
        return f"tick_ack after tick {self.acknowledged_tick} from {RECORDER}"

    def _refuse_ungranted(self, name: str, tick: int) -> None:
        if tick > self._granted:
            raise ProtocolError(f"{name}: tick {tick} came, granted is tick {self._granted}")
