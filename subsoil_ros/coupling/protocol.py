"""Lockstep as state machines without IO: no ROS, no clock, no threads.

The coupler grants ticks ahead within a window, mover and soil answer each other tick by tick, and the
recorder acknowledges what it has written. Whatever the interleaving, each tick happens exactly once:
a message that is missing, repeated, foreign or malformed is a ProtocolError. The last tick is granted
with END. ABORT names the last tick of the record.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from ..errors import ProtocolError, RunError
from ..messages import (
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
from ..scene.model import Scene
from ..ticks import INITIAL_TICK

COUPLER = "coupler"
MECHANISM = "mechanism"
SOIL = "soil"
RECORDER = "recorder"

ACK_LAG_TICKS = 256
"""Ticks that the recorder may be behind the grants."""

ACK_EVERY_TICKS = 16
"""The recorder acknowledges at least so often; below ACK_LAG_TICKS, or the run would stand still."""

Answer = TypeVar("Answer", ToolMotions, ToolWrenches)
Payload = TypeVar("Payload")


def participants(scene: Scene) -> tuple[str, ...]:
    """Nodes a run of the scene needs beside the coupler."""
    names = [name for name, part in ((MECHANISM, scene.mechanism), (SOIL, scene.soil)) if part is not None]
    return (*names, RECORDER)


class Stream:
    """The ticks of one kind of message: all of one run, each exactly once, in order."""

    def __init__(self, name: str, run_id: str, tick_count: int, first: int = 0) -> None:
        self.next_tick = first
        self._name = name
        self._run_id = run_id
        self._tick_count = tick_count

    def accept(self, run_id: str, tick: int) -> None:
        """Takes the next message.

        Raises:
            ProtocolError: it is of another run, or not of the expected tick.
        """
        self.refuse_foreign(run_id, tick)
        if tick != self.next_tick:
            what = "repeated" if tick < self.next_tick else f"{tick - self.next_tick} missing"
            raise ProtocolError(f"{self._name}: tick {tick} came where tick {self.next_tick} is due ({what})")
        if tick >= self._tick_count:
            raise ProtocolError(
                f"{self._name}: tick {tick} came, but the run ends with tick {self._tick_count - 1}"
            )
        self.next_tick += 1

    def refuse_foreign(self, run_id: str, tick: int) -> None:
        """Raises ProtocolError if a message of `tick` is of another run."""
        if run_id != self._run_id:
            raise ProtocolError(
                f"{self._name}: tick {tick} is of run '{run_id}', this is run '{self._run_id}', at tick "
                f"{self.next_tick}; give every run a ROS_DOMAIN_ID of its own"
            )


def _refuse_other_tools(name: str, tick: int, given: tuple[str, ...], tools: tuple[str, ...]) -> None:
    if given != tools:
        raise ProtocolError(f"{name}: tick {tick} speaks of tools {list(given)}, the scene has {list(tools)}")


class AnswerStream(Stream, Generic[Answer]):
    """Motions or wrenches, kept until they are taken in order."""

    def __init__(self, name: str, run_id: str, tick_count: int, tools: tuple[str, ...]) -> None:
        super().__init__(name, run_id, tick_count)
        self._tools = tools
        self._kept: deque[Answer] = deque()

    def add(self, answer: Answer) -> None:
        """Keeps the next answer; ProtocolError if it is not the next, or not of these tools."""
        self.accept(answer.run_id, answer.tick)
        _refuse_other_tools(self._name, answer.tick, tuple(t.tool for t in answer.tools), self._tools)
        self._kept.append(answer)

    def __len__(self) -> int:
        return len(self._kept)

    def take(self) -> Answer:
        """The oldest answer kept."""
        return self._kept.popleft()


class Needs(Enum):
    """What a participant needs to advance tick k, beside the grant of it."""

    NOTHING = "nothing"  # a mechanism without soil, a soil that moves its tools itself
    WRENCHES = "wrenches of tick k-1"
    MOTIONS = "motions of tick k"


@dataclass(frozen=True)
class Work:
    """A tick that can be advanced now, and what it needs."""

    tick: int
    motions: tuple[ToolMotion, ...] = ()
    wrenches: tuple[ToolWrench, ...] = ()


class Participant:
    """Mover or soil: takes messages in any interleaving, hands out each tick once, in order."""

    def __init__(self, run_id: str, tick_count: int, needs: Needs, tools: tuple[str, ...]) -> None:
        self.last_tick = tick_count - 1
        self.done_tick = INITIAL_TICK  # last tick handed out and finished
        self.abort: Grant | None = None
        self._needs = needs
        self._grants = Stream("grant", run_id, tick_count)
        self._motions = AnswerStream[ToolMotions]("tool_motions", run_id, tick_count, tools)
        self._wrenches = AnswerStream[ToolWrenches]("tool_wrenches", run_id, tick_count, tools)
        self._initial_wrenches: tuple[ToolWrench, ...] | None = None
        self._at_work = False

    def start(self, wrenches: tuple[ToolWrench, ...]) -> None:
        """Takes the wrenches of the initial state, which tick 0 needs."""
        self._initial_wrenches = wrenches

    def accept_grant(self, grant: Grant) -> None:
        """Takes a grant. ABORT may come at any time, and nothing is handed out after it."""
        if grant.command is Command.ABORT:
            self._grants.refuse_foreign(grant.run_id, grant.tick)
            self.abort = self.abort or grant
            return
        self._grants.accept(grant.run_id, grant.tick)
        if (grant.command is Command.END) != (grant.tick == self.last_tick):
            raise ProtocolError(
                f"grant: {grant.command.name} came with tick {grant.tick}, the last tick is {self.last_tick}"
            )

    def accept_motions(self, motions: ToolMotions) -> None:
        """Takes the motions of a tick."""
        self._motions.add(motions)

    def accept_wrenches(self, wrenches: ToolWrenches) -> None:
        """Takes the wrenches of a tick."""
        self._wrenches.add(wrenches)

    def next_work(self) -> Work | None:
        """The next tick with what it needs, once; None while something is missing.

        The tick is to be advanced and `finish`ed before the next is handed out.
        """
        tick = self.done_tick + 1
        if self._at_work or self.abort or tick >= self._grants.next_tick or tick > self.last_tick:
            return None
        motions: tuple[ToolMotion, ...] = ()
        wrenches: tuple[ToolWrench, ...] = ()
        if self._needs is Needs.MOTIONS:
            if not self._motions:
                return None
            motions = self._motions.take().tools
        elif self._needs is Needs.WRENCHES:
            if tick == 0:
                if self._initial_wrenches is None:
                    return None
                wrenches = self._initial_wrenches
            elif self._wrenches:
                wrenches = self._wrenches.take().tools
            else:
                return None
        self._at_work = True
        return Work(tick, motions, wrenches)

    def finish(self, tick: int) -> None:
        """Says that the tick handed out is advanced."""
        if not self._at_work or tick != self.done_tick + 1:
            raise ProtocolError(f"tick {tick} is finished where tick {self.done_tick + 1} is at work")
        self._at_work = False
        self.done_tick = tick

    @property
    def finished(self) -> bool:
        """Whether the last tick is done."""
        return self.done_tick == self.last_tick


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
    """

    def __init__(
        self,
        hello: NodeHello,
        names: tuple[str, ...],
        tools: tuple[str, ...],
        tick_count: int,
        grant_window: int,
        soil: bool,
    ) -> None:
        self.last_tick = tick_count - 1
        self.done_tick = INITIAL_TICK
        self.acknowledged_tick = INITIAL_TICK if RECORDER in names else self.last_tick
        self.abort_grant: Grant | None = None
        self.initial_motions: tuple[ToolMotion, ...] = ()
        self.initial_wrenches: tuple[ToolWrench, ...] = ()
        self._own = hello
        self._tools = tools
        self._window = grant_window
        self._soil = soil
        self._granted = INITIAL_TICK
        self._waiting = set(names)
        self._names = names
        self._process_ids: dict[str, int] = {}
        run_id = hello.run_id
        self._acks = Stream("tick_ack", run_id, tick_count)
        self._motions = AnswerStream[ToolMotions]("tool_motions", run_id, tick_count, tools)
        self._wrenches = AnswerStream[ToolWrenches]("tool_wrenches", run_id, tick_count, tools)

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
            _refuse_other_tools("node_hello", INITIAL_TICK, given_tools, self._tools)
            self.initial_motions = hello.initial_motions
        if hello.node == SOIL:
            given_tools = tuple(t.tool for t in hello.initial_wrenches)
            _refuse_other_tools("node_hello", INITIAL_TICK, given_tools, self._tools)
            self.initial_wrenches = hello.initial_wrenches
        self._waiting.discard(hello.node)

    def next_grants(self) -> tuple[Grant, ...]:
        """The grants that can be given now, each once; none before everybody is ready."""
        if not self.ready or self.abort_grant:
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


class RecordBarrier(Generic[Payload]):
    """The recorder's side: collects what is due at a tick, and hands out whole ticks in order.

    An abort names the last tick that the coupler has finished, and others may be ahead of it. So a tick is
    handed out only when it is certain that no abort will name an earlier one.

    Args:
        due: names of the messages due at a tick, in the order in which they are recorded.
        grant_window: a grant of tick k says that the coupler has finished tick k - grant_window.
    """

    def __init__(self, tick_count: int, due: Callable[[int], tuple[str, ...]], grant_window: int) -> None:
        self.last_tick = tick_count - 1
        self.done_tick = INITIAL_TICK
        self._window = grant_window
        self._certain = INITIAL_TICK  # no abort names an earlier tick
        self.cut_tick = self.last_tick  # the record ends here; earlier after an abort
        self._acknowledged = INITIAL_TICK
        self._due = due
        self._kept: dict[int, dict[str, Payload]] = {}

    def add(self, name: str, tick: int, payload: Payload) -> None:
        """Keeps a message.

        Raises:
            ProtocolError: it is repeated, or not due at its tick.
        """
        if name not in self._due(tick) or tick > self.last_tick:
            raise ProtocolError(f"{name}: tick {tick} came, nothing of it is due then")
        kept = self._kept.setdefault(tick, {})
        if tick <= self.done_tick or name in kept:
            raise ProtocolError(
                f"{name}: tick {tick} is repeated, the record stands at tick {self.done_tick}"
            )
        kept[name] = payload

    def note_grant(self, tick: int) -> None:
        """Takes it that `tick` is granted."""
        self.note_finished(tick - self._window)

    def note_finished(self, tick: int) -> None:
        """Takes it that the coupler has finished `tick`, or will never name one again."""
        self._certain = max(tick, self._certain)

    def cut(self, tick: int) -> None:
        """Ends the record with `tick`, the one that an abort names."""
        self.cut_tick = min(tick, self.cut_tick)
        self.note_finished(tick)

    def take_tick(self) -> tuple[int, list[tuple[str, Payload]]] | None:
        """The next tick of which everything is here, in recording order; None while some is missing."""
        tick = self.done_tick + 1
        kept = self._kept.get(tick, {})
        if tick > min(self.cut_tick, self._certain) or len(kept) < len(self._due(tick)):
            return None
        del self._kept[tick]
        self.done_tick = tick
        return tick, [(name, kept[name]) for name in self._due(tick)]

    def next_ack(self) -> int | None:
        """The tick to acknowledge now, if it is time to; the last is acknowledged in any case."""
        if self.done_tick < self._acknowledged + ACK_EVERY_TICKS and self.done_tick != self.last_tick:
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
        """What the next tick waits for, in words."""
        tick = self.done_tick + 1
        kept = self._kept.get(tick, {})
        return f"tick {tick}: {', '.join(name for name in self._due(tick) if name not in kept)}"
