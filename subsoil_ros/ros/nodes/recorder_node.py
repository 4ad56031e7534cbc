"""The recorder as a node: writes every message of every tick, and acknowledges ticks to the coupler."""

import time
from collections.abc import Callable, Sequence
from functools import partial

from rclpy.context import Context

from ...coupling.protocol import CONTROLLER, COUPLER, MECHANISM, RECORDER, SOIL, RecordBarrier
from ...coupling.run_settings import RunSettings
from ...coupling.time_limits import CUT_S
from ...errors import InputError, ProtocolError, RunError
from ...loading.loader import ResolvedScene
from ...messages import (
    Command,
    CouplingReport,
    DriverCommand,
    Grant,
    Head,
    MechanismState,
    NodeState,
    NodeStatus,
    SoilCloud,
    SoilState,
    TickAck,
    ToolMotions,
    ToolWrenches,
)
from ...recording.bag_writer import BagWriter, open_bag
from ...recording.message_codec import reader, writer
from ...recording.standard_messages import time_ns_of
from ...recording.topics import TOPIC_OF
from ...recording.types import deserialize, message_type
from ...scene.scene import Scene
from ...ticks import INITIAL_TICK
from ..process.heartbeat import Heartbeat
from ..process.node_process import run_process
from .diagnostics import Health
from .lockstep_node import LockstepNode

_LOCKSTEP = (Grant, DriverCommand, ToolMotions, ToolWrenches)


def _topics(scene: Scene) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Topics of the exchange of every tick, without grants, and topics of the states, in recording order."""
    soil, mechanism = scene.soil is not None, scene.mechanism is not None
    exchanged = (ToolMotions, *((ToolWrenches,) if soil else ()))
    states = (*((MechanismState,) if mechanism else ()), *((SoilState,) if soil else ()), CouplingReport)
    return tuple(TOPIC_OF[kind] for kind in exchanged), tuple(TOPIC_OF[kind] for kind in states)


def due_topics(resolved: ResolvedScene, *, at_end: bool = False) -> Callable[[int], tuple[str, ...]]:
    """Return the function that gives the topics recorded for a tick of the scene, in recording order.

    at_end: if the run ends with that tick.
    """
    schedule = resolved.schedule
    exchanged, series = _topics(resolved.scene)
    every = (TOPIC_OF[Grant], *exchanged)
    command = (TOPIC_OF[DriverCommand],)
    cloud = (TOPIC_OF[SoilCloud],)

    def due(tick: int) -> tuple[str, ...]:
        of_tick = schedule.ends_with(tick) if at_end else schedule
        states_due = series if of_tick.series_due(tick) else ()
        commands_due = command if of_tick.control_due(tick) else ()
        return every + commands_due + states_due + (cloud if of_tick.cloud_due(tick) else ())

    return due


def initial_topics(resolved: ResolvedScene) -> tuple[str, ...]:
    """Topics of the state before tick 0, in recording order."""
    exchanged, states = _topics(resolved.scene)
    return exchanged + states


class RecorderNode(LockstepNode):
    """The recorder in the lockstep: it acknowledges ticks once they are written."""

    def __init__(
        self, writer: BagWriter, run: RunSettings, heartbeat: Heartbeat, context: Context | None = None
    ) -> None:
        super().__init__(RECORDER, run, heartbeat, context)
        scene = run.resolved.scene
        self._writer = writer
        self._barrier: RecordBarrier[bytes] = RecordBarrier(
            run.schedule,
            due_topics(run.resolved),
            scene.coupling.grant_window,
            due_at_end=due_topics(run.resolved, at_end=True),
            initial=initial_topics(run.resolved) if run.resumed is None else (),
        )
        self._motion_source = MECHANISM if scene.moved_by_participant else SOIL
        self._initial_from = {self._motion_source} | ({SOIL} if scene.soil is not None else set())
        self._abort: Grant | None = None
        self._keep_tick = INITIAL_TICK  # CHECKPOINT was granted for it, beside the ticks that are due
        self._cut_deadline = 0.0
        self._acks = self.publisher(TickAck, (COUPLER,))
        self.listen(NodeStatus, self._on_node_status, ())
        self._read_grant, self._read_head = reader(Grant), reader(Head)
        exchanged: list[tuple[type, str]] = [(Grant, COUPLER), (ToolMotions, self._motion_source)]
        sources: list[tuple[type, str]] = [(CouplingReport, COUPLER)]
        if scene.mechanism is not None:
            sources.append((MechanismState, MECHANISM))
        if scene.soil is not None:
            exchanged.append((ToolWrenches, SOIL))
            sources.append((SoilState, SOIL))
        if run.schedule.cloud_ticks:
            sources.append((SoilCloud, SOIL))
        if scene.controller is not None:
            sources.append((DriverCommand, CONTROLLER))
        for kind, source in exchanged:
            self.listen_ticks_raw(kind, partial(self._on_messages, kind), source)
        for kind, source in sources:
            self.listen_raw(kind, partial(self._on_message, kind), (source,))

    def on_poll(self) -> None:
        """Publish READY once every node is there; end an aborted record in time."""
        if self.heartbeat.state is NodeState.STARTING and self.matched:
            self.say_ready()
        if self._abort is not None and time.monotonic() > self._cut_deadline:
            self.get_logger().warning(f"the record is cut early; missing is {self._barrier.missing()}")
            self._end_aborted(self._abort)

    def health(self) -> Health:
        """The last tick recorded, and the messages that the next one waits for."""
        barrier = self._barrier
        return Health(values={"recorded_tick": barrier.done_tick, "waits_for": barrier.missing()})

    def on_fault(self, error: BaseException) -> None:
        """Close the bag, so that it can be read; with all whole ticks if no coupler is left to cut it."""
        try:
            if self.heartbeat.lost or self.heartbeat.stop:
                self._barrier.note_finished(self._barrier.last_tick)
                self._record()
            self._writer.close()
        except RunError as second:
            self.get_logger().error(f"the bag could not be closed: {second}")

    def _on_node_status(self, node_status: NodeStatus) -> None:
        """Record the initial exchange, which nodes publish with READY and on no other topic."""
        self.follow_coupler_end(node_status)
        name, run_id = node_status.node, self.run.run_id
        if node_status.state is not NodeState.READY or name not in self._initial_from:
            return
        if self.run.resumed is not None or node_status.run_id != run_id:
            return
        self._initial_from.discard(name)
        records: list[ToolMotions | ToolWrenches] = []
        if name == self._motion_source:
            records.append(ToolMotions(run_id, INITIAL_TICK, 0, node_status.initial_motions))
        if name == SOIL:
            records.append(ToolWrenches(run_id, INITIAL_TICK, 0, node_status.initial_wrenches))
        for record in records:
            cdr = writer(type(record), self._communication_step_ns)(record)
            self._barrier.add(TOPIC_OF[type(record)], INITIAL_TICK, cdr)
        self._record()

    def _on_messages(self, kind: type, messages: Sequence[bytes]) -> None:
        for cdr in messages:
            if self.ended.is_set():
                return
            if kind is Grant:
                self._on_grant(cdr)
            else:
                self._on_message(kind, cdr)

    def _on_grant(self, cdr: bytes) -> None:
        grant = self._read_grant(cdr)
        if grant.command is Command.ABORT:
            self._refuse_other_run(Grant, grant.run_id, grant.tick)
            self._abort = grant
            self._cut_deadline = time.monotonic() + CUT_S
            self._barrier.cut(grant.tick)
            self._record()
            return
        if grant.command is Command.CHECKPOINT:
            self._refuse_other_run(Grant, grant.run_id, grant.tick)
            self._barrier.note_finished(grant.tick)
            self._record()
            if self._barrier.done_tick == grant.tick:
                self._sync_and_acknowledge()
            else:
                self._keep_tick = grant.tick  # some of its messages have not come yet
            return
        if grant.command is Command.END:
            self._refuse_other_run(Grant, grant.run_id, grant.tick)
            self._barrier.end(grant.tick)
        self._on_message(Grant, cdr)

    def _on_message(self, kind: type, cdr: bytes) -> None:
        if kind is SoilCloud:
            run_id, end_ns = "", time_ns_of(deserialize(cdr, message_type(kind)).header.stamp)
        else:
            head = self._read_head(cdr)
            run_id, end_ns = head.run_id, head.end_time_ns
        tick, rest = divmod(end_ns, self._communication_step_ns)
        if rest:
            raise ProtocolError(
                f"{TOPIC_OF[kind]}: stamp {end_ns} ns is no whole number of ticks of "
                f"{self._communication_step_ns} ns"
            )
        if kind is MechanismState and self.run.resumed is not None and tick - 1 < self._first_tick:
            return  # of the earlier run, published for the controller
        if kind in _LOCKSTEP:
            self._refuse_other_run(kind, run_id, tick - 1)
        self._barrier.add(TOPIC_OF[kind], tick - 1, cdr)
        if kind is Grant:
            self._barrier.note_grant(tick - 1)
        elif kind is CouplingReport:
            self._barrier.note_finished(tick - 1)
        self._record()

    def _refuse_other_run(self, kind: type, run_id: str, tick: int) -> None:
        if run_id != self.run.run_id:
            raise ProtocolError(
                f"{TOPIC_OF[kind]}: tick {tick} is of run '{run_id}', this is run '{self.run.run_id}', at "
                f"tick {self._barrier.done_tick}; give every run a ROS_DOMAIN_ID of its own"
            )

    def _record(self) -> None:
        barrier = self._barrier
        while (whole := barrier.take_tick()) is not None:
            tick, messages = whole
            for topic, cdr in messages:
                self._writer.write_raw(topic, tick, cdr)
            last = tick == barrier.last_tick
            if last:
                self._writer.close()  # the last acknowledgement means that the bag is finished
            self.note_tick(tick, last)
            if tick == INITIAL_TICK:
                continue
            if barrier.schedule.checkpoint_due(tick) or tick == self._keep_tick:
                self._sync_and_acknowledge()
            else:
                self._acknowledge(barrier.next_ack())
        if self._abort is not None and barrier.finished:
            self._end_aborted(self._abort)

    def _sync_and_acknowledge(self) -> None:
        """Write the record to the disk, as a checkpoint needs it, and acknowledge it."""
        self._writer.sync()
        self._acknowledge(self._barrier.next_ack(at_once=True))

    def _acknowledge(self, tick: int | None) -> None:
        if tick is not None:
            self._acks.publish(self.bytes_of(TickAck(self.run.run_id, tick)))

    def _end_aborted(self, grant: Grant) -> None:
        self._writer.close()
        self.finish_aborted(grant)


def build(run: RunSettings, heartbeat: Heartbeat, context: Context | None = None) -> RecorderNode:
    """The node with its bag.

    Raises:
        InputError: no folder is named, or it exists, or cannot be created, or the live view cannot serve.
    """
    if run.bag is None:
        raise InputError("recorder: parameter 'bag' is empty; name the folder for the bag, -p bag:=FOLDER")
    writer = open_bag(run.bag, run.resolved, run.live_port)
    return RecorderNode(writer, run, heartbeat, context)


def main() -> int:
    """Runs the node as a process."""
    return run_process(RECORDER, build)


if __name__ == "__main__":
    raise SystemExit(main())
