"""The real state machines of a run, joined by queues: one for each kind of message and receiver.

A node works as soon as it can: a slow node cannot be told from one whose messages are late. What a test
chooses is which queue moves next, which message is lost or comes twice, and when the user pauses, steps,
resumes or aborts. Everything in a System can be copied by pickle.
"""

import io
import pickle
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from subsoil_ros.coupling.protocol import (
    CONTROLLER,
    COUPLER,
    MECHANISM,
    RECORDER,
    SOIL,
    Commander,
    Coupler,
    Needs,
    Participant,
    RecordBarrier,
)
from subsoil_ros.errors import ProtocolError
from subsoil_ros.messages import (
    Command,
    DriverCommand,
    Grant,
    MechanismState,
    NodeState,
    NodeStatus,
    TickAck,
    ToolMotion,
    ToolMotions,
    ToolWrench,
    ToolWrenches,
)
from subsoil_ros.schedule import Schedule

RUN, TOOLS = "run", ("share",)


@dataclass(frozen=True)
class Case:
    """A small run."""

    ticks: int = 3
    window: int = 2
    soil: bool = True
    series_ticks: int = 1
    control_ticks: int = 0
    first_tick: int = 0  # later where the run goes on from another; then without controller
    paused: bool = False
    check_ticks: int = 0  # the run may end early every so many ticks; then without controller
    stop_tick: int = -1  # the check tick that ends the run
    prompt: bool = True  # what is sent to the recorder is there at once; its acknowledgements may be late

    @property
    def schedule(self) -> Schedule:
        """What is due at each tick, were it not for a check that ends the run."""
        return Schedule(
            self.ticks, self.series_ticks, control_ticks=self.control_ticks, check_ticks=self.check_ticks,
            first_tick=self.first_tick,
        )  # fmt: skip

    @property
    def last_tick(self) -> int:
        """With which the run ends."""
        return self.ticks - 1 if self.stop_tick < 0 else self.stop_tick + 1


def motion(tick: int) -> tuple[ToolMotion, ...]:
    """A motion that tells its tick."""
    return (ToolMotion("share", float(tick), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),)


def wrench(tick: int) -> tuple[ToolWrench, ...]:
    """A wrench that tells its tick."""
    return (ToolWrench("share", float(tick), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0),)


def node_status(node: str, state: NodeState = NodeState.READY, run_id: str = RUN, **other: Any) -> NodeStatus:
    """A node's word."""
    values = {
        "scene_hash": "hash", "package_version": "1", "message_hashes": (), "capabilities": (),
        "process_id": 1, "tick": -1, **other,
    }  # fmt: skip
    return NodeStatus(run_id, node, state, **values)


@dataclass(frozen=True)
class Due:
    """What the recorder waits for at a tick; at_end: if the run ends with it."""

    case: Case
    at_end: bool = False

    def __call__(self, tick: int) -> tuple[str, ...]:
        case = self.case
        names = ["grant"]
        names += ["driver_command"] if case.schedule.control_due(tick) else []
        names += ["tool_motions"] + (["tool_wrenches"] if case.soil else [])
        series = (tick + 1) % case.series_ticks == 0 or tick == case.ticks - 1 or self.at_end
        return (*names, *(("mechanism_state", "coupling_report") if series else ()))


NAMES = {
    Grant: "grant", DriverCommand: "driver_command", ToolMotions: "tool_motions",
    ToolWrenches: "tool_wrenches", MechanismState: "mechanism_state", str: "coupling_report",
}  # fmt: skip


@dataclass
class System:
    """All nodes and what is on its way between them. Whoever does a tick twice, or not in order, is found."""

    case: Case
    queues: dict[tuple[str, str], deque] = field(default_factory=dict)
    done: dict[str, int] = field(default_factory=dict)  # last tick, by node
    fault: str = ""
    checked: int = -2  # the last check tick that was decided

    def __post_init__(self) -> None:
        case = self.case
        names = [MECHANISM, *([SOIL] if case.soil else []), *([CONTROLLER] if case.control_ticks else [])]
        self.listeners = (*names, RECORDER)
        kinds = (*NAMES.values(), "tick_ack")
        self.queues = {(kind, name): deque() for kind in kinds for name in (*self.listeners, COUPLER)}
        self.done = {
            name: 0 if name == CONTROLLER else case.first_tick - 1 for name in (*self.listeners, COUPLER)
        }
        self.schedule = case.schedule
        self.coupler = Coupler(
            node_status(COUPLER), self.listeners, TOOLS, case.schedule, case.window, paused=case.paused
        )
        first = case.first_tick
        needs = Needs.WRENCHES if case.soil else Needs.NOTHING
        self.nodes = {MECHANISM: Participant(RUN, case.schedule, needs, TOOLS, commanded=True)}
        self.nodes[MECHANISM].start(wrench(first - 1))
        if case.soil:
            self.nodes[SOIL] = Participant(RUN, case.schedule, Needs.MOTIONS, TOOLS)
        self.commander = None
        if case.control_ticks:
            self.commander = Commander(RUN, case.schedule)
        self.barrier: RecordBarrier[Any] = RecordBarrier(
            case.schedule, Due(case), case.window, due_at_end=Due(case, at_end=True)
        )
        for name in self.listeners:
            initial = {"initial_motions": motion(-1)} if name == MECHANISM else {}
            initial = {"initial_wrenches": wrench(-1)} if name == SOIL else initial
            self.coupler.accept_node_status(node_status(name, **initial))
        self._check(first - 1)
        self._grant()

    def due(self, tick: int) -> tuple[str, ...]:
        """What is recorded of a tick."""
        return Due(self.case, at_end=tick == self.case.last_tick)(tick)

    def frozen(self) -> bytes:
        """The whole state; pickle.loads gives it back. Equal states built alike give equal bytes."""
        stream = io.BytesIO()
        pickler = pickle.Pickler(stream, pickle.HIGHEST_PROTOCOL)
        pickler.fast = True  # without references, which tell of the past
        pickler.dump(self)
        return stream.getvalue()

    def moving(self) -> list[tuple[str, str]]:
        """Queues that are not empty."""
        return [key for key, queue in self.queues.items() if queue]

    def deliver(self, key: tuple[str, str]) -> None:
        """The first message of a queue arrives; a node that refuses it ends the run by its fault."""
        message = self.queues[key].popleft()
        try:
            self._deliver(key[1], message)
        except ProtocolError as error:
            self.fault = str(error)

    def lose(self, key: tuple[str, str]) -> None:
        """The first message of a queue never arrives."""
        self.queues[key].popleft()

    def repeat(self, key: tuple[str, str]) -> None:
        """The first message of a queue will arrive twice."""
        self.queues[key].appendleft(self.queues[key][0])

    def pause(self) -> None:
        """The user pauses."""
        self.coupler.pause()

    def resume(self) -> None:
        """The user resumes."""
        self.coupler.resume()
        self._grant()

    def step(self, count: int) -> None:
        """The user steps."""
        self.coupler.step(count)
        self._grant()

    def abort(self) -> None:
        """The coupler gives up."""
        self._send(self.coupler.abort("asked for"), *self.listeners)

    @property
    def complete(self) -> bool:
        """Every tick done by every participant, and recorded."""
        return (
            self.coupler.finished
            and self.barrier.finished
            and all(node.finished for node in self.nodes.values())
        )

    def _send(self, message: Any, *receivers: str) -> None:
        for receiver in receivers:
            if receiver == RECORDER and self.case.prompt:
                self._deliver_recorder(message)
                continue
            if receiver == CONTROLLER and isinstance(message, Grant) and message.command is not Command.ABORT:
                continue  # they say nothing to it
            self.queues[NAMES.get(type(message), "tick_ack"), receiver].append(message)

    def _note(self, name: str, tick: int, every: int = 1) -> None:
        assert tick == self.done[name] + every, "a tick twice, or left out"
        self.done[name] = tick

    def _check(self, tick: int) -> None:
        """The decision of a check tick."""
        if self.schedule.check_due(tick):
            self.coupler.decide(tick, ends=tick == self.case.stop_tick)
            self.checked = tick

    def _grant(self) -> None:
        for grant in self.coupler.next_grants():
            checks = range(self.case.first_tick - 1, grant.tick)
            due = max(filter(self.schedule.check_due, checks), default=self.checked)
            assert due == self.checked, "granted beyond a check tick before its decision"
            assert (grant.command is Command.END) == (grant.tick == self.case.last_tick)
            assert grant.tick <= self.coupler.done_tick + self.case.window
            self._send(grant, *self.listeners)

    def _deliver(self, receiver: str, message: Any) -> None:
        if receiver == COUPLER:
            self._deliver_coupler(message)
        elif receiver == RECORDER:
            self._deliver_recorder(message)
        elif receiver == CONTROLLER:
            self._deliver_controller(message)
        elif self.nodes[receiver].abort is None:
            node = self.nodes[receiver]
            accept = {
                Grant: node.accept_grant, ToolMotions: node.accept_motions,
                ToolWrenches: node.accept_wrenches, DriverCommand: node.accept_command,
            }  # fmt: skip
            accept[type(message)](message)
            self._work(receiver, node)

    def _work(self, name: str, node: Participant) -> None:
        case = self.case
        while (work := node.next_work()) is not None:
            tick = work.tick
            assert tick <= self.coupler.done_tick + case.window, "ran ahead"
            self._note(name, tick)
            if name == MECHANISM:
                assert work.wrenches == (wrench(tick - 1) if case.soil else ())
                controlled = self.schedule.control_due(tick)
                assert (work.command.tick == tick) if controlled else work.command is None
                others = [SOIL] if case.soil else []
                self._send(ToolMotions(RUN, tick, 0, motion(tick)), *others, COUPLER, RECORDER)
                if "mechanism_state" in self.due(tick):
                    state = MechanismState(RUN, tick, 0, *[0.0] * 10, 0)
                    self._send(state, *([CONTROLLER] if case.control_ticks else []), RECORDER)
            else:
                assert work.motions == motion(tick)
                self._send(ToolWrenches(RUN, tick, 0, wrench(tick)), MECHANISM, COUPLER, RECORDER)
            node.finish(tick)

    def _deliver_controller(self, message: Any) -> None:
        assert self.commander is not None
        if isinstance(message, Grant):
            self.commander.accept_grant(message)
        elif self.commander.abort is None:
            tick = self.commander.accept_state(message)
            if tick is not None:
                self._note(CONTROLLER, tick, self.case.control_ticks)
                self._send(DriverCommand(RUN, tick, "drive", 0.0), MECHANISM, COUPLER, RECORDER)

    def _deliver_coupler(self, message: Any) -> None:
        if self.coupler.abort_grant is not None:
            return  # its node has ended
        accept = {
            ToolMotions: self.coupler.accept_motions, ToolWrenches: self.coupler.accept_wrenches,
            TickAck: self.coupler.accept_ack, DriverCommand: self.coupler.accept_command,
        }  # fmt: skip
        accept[type(message)](message)
        while (finished := self.coupler.take_finished()) is not None:
            assert finished.motions == motion(finished.tick)
            assert finished.wrenches == (wrench(finished.tick) if self.case.soil else ())
            self._note(COUPLER, finished.tick)
            if "coupling_report" in self.due(finished.tick):
                self._send(f"report {finished.tick}", RECORDER)
            self._check(finished.tick)
        self._grant()

    def _deliver_recorder(self, message: Any) -> None:
        barrier = self.barrier
        if isinstance(message, Grant) and message.command is Command.ABORT:
            barrier.cut(message.tick)
        else:
            name = NAMES[type(message)]
            tick = int(message.split()[1]) if isinstance(message, str) else message.tick
            if isinstance(message, Grant) and message.command is Command.END:
                barrier.end(tick)
            barrier.add(name, tick, message)
            if name == "grant":
                barrier.note_grant(tick)
            elif name == "coupling_report":
                barrier.note_finished(tick)
        while (whole := barrier.take_tick()) is not None:
            self._note(RECORDER, whole[0])
            assert tuple(name for name, _ in whole[1]) == self.due(whole[0])
            acknowledged = barrier.next_ack()
            if acknowledged is not None:
                self._send(TickAck(RUN, acknowledged), COUPLER)
