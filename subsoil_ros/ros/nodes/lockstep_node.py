"""Base class of the nodes of a run: readiness, end, and handling of errors."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from ...coupling.exit_status import ExitStatus
from ...coupling.protocol import COUPLER, RECORDER
from ...coupling.run_settings import RunSettings
from ...coupling.time_limits import LAST_WORD_S, POLL_S, WAITING_S
from ...errors import ProtocolError, RunError
from ...messages import Grant, NodeState, NodeStatus, RunRecord, ToolMotion, ToolWrench
from ...recording.message_batches import unpacked
from ...recording.message_codec import reader, writer
from ...recording.topics import TOPIC_OF, batch_topic
from ...recording.types import BATCH
from ..process.heartbeat import Heartbeat
from ..process.node_process import OWN_TIME, log_end, one_line, say_trace
from ..transport.private_rclpy import serve, serve_requests
from ..transport.publishers import unknown_publishers
from ..transport.qos import LOCKSTEP_QOS, class_of, qos_of, rclpy_class
from ..transport.tick_publisher import TickPublisher
from .diagnostics import Diagnostics, Health, Level


class _Endpoint(NamedTuple):
    """A publisher or subscription, and the names of the nodes at its other end."""

    endpoint: Publisher | Subscription
    names: Callable[[], tuple[str, ...]]


class _Source(NamedTuple):
    """A node whose messages of every tick are listened to; single or in batches, as it publishes them."""

    kind: type
    handle: Callable[[Sequence[bytes]], None]
    node: str

    def take_single(self, cdr: bytes) -> None:
        """Handle a message."""
        self.handle((cdr,))

    def take_batch(self, batch: bytes) -> None:
        """Handle the messages of a batch."""
        self.handle(unpacked(batch))


class LockstepNode(Node):
    """A node of a run. Subclasses add topics, `on_poll` and `on_coupler_end`.

    Everything runs in the one thread that calls `spin`. An error in a callback is the node's fault: the node
    publishes it in a NodeStatus, and ends with the error's exit status.
    """

    def __init__(
        self, name: str, run: RunSettings, heartbeat: Heartbeat, context: Context | None = None
    ) -> None:
        super().__init__(
            name,
            context=context,
            start_parameter_services=False,
            parameter_overrides=[*OWN_TIME, Parameter("start_type_description_service", value=False)],
        )
        self.run = run
        self.heartbeat = heartbeat
        self.ended = threading.Event()
        self.status = ExitStatus()
        self._first_tick = run.schedule.first_tick
        self._batch_ticks = max(1, run.resolved.scene.coupling.grant_window // 2)  # engines do the other half
        self._communication_step_ns = run.resolved.timing.communication_step_ns
        self._writers: dict[type, Callable[[Any], bytes]] = {}
        self._partners: list[_Endpoint] = []
        self._tick_publishers: list[TickPublisher] = []
        heartbeat.at_beat(self.flush)
        self._sources: list[_Source] = []  # not heard of yet
        self._guarded_topics: dict[str, tuple[str, ...]] = {}  # not listened to: who may publish on them
        self._diagnostics = Diagnostics(self, run.run_id, self._communication_step_ns)
        self._waited_for = ""  # logged last
        self._next_waiting = time.monotonic() + WAITING_S

    def spin(self) -> None:
        """Serve the node until it ends."""
        serve(self, self._guarded(self._poll), POLL_S, self.ended.is_set)

    def serve_ended(self, over: Callable[[], bool]) -> None:
        """Answer requests that come after the end of the run, until `over`, without endpoints of the run."""
        for endpoint, _ in self._partners:
            if isinstance(endpoint, Publisher):
                self.destroy_publisher(endpoint)
            else:
                self.destroy_subscription(endpoint)
        serve_requests(self, self.on_ended, POLL_S, over)

    def listen(self, kind: type, handle: Callable[[Any], None], partners: tuple[str, ...]) -> None:
        """Subscribe to records of `kind` from the `partners`, and pass them to `handle`."""

        read = reader(kind)
        self.listen_raw(kind, lambda cdr: handle(read(cdr)), partners)

    def listen_ticks(self, kind: type, handle: Callable[[list[Any]], None], node: str) -> None:
        """Subscribe to records of `kind`, one a tick, from a node, and pass those that come together to
        `handle`."""

        read = reader(kind)
        self.listen_ticks_raw(kind, lambda messages: handle([read(cdr) for cdr in messages]), node)

    def listen_grants(self, accept: Callable[[Grant], None], work: Callable[[], None]) -> None:
        """Subscribe to grants: pass each to `accept`, then call `work` once for those that came together."""

        def handle(grants: list[Grant]) -> None:
            for grant in grants:
                accept(grant)
            if not self.ended.is_set():
                work()

        self.listen_ticks(Grant, handle, COUPLER)

    def listen_ticks_raw(self, kind: type, handle: Callable[[Sequence[bytes]], None], node: str) -> None:
        """The same with the CDR bytes of the messages."""
        self._sources.append(_Source(kind, handle, node))

    def listen_raw(self, kind: type, handle: Callable[[bytes], None], partners: tuple[str, ...]) -> None:
        """Subscribe to records of `kind` from the `partners`, and pass their CDR bytes to `handle`.

        A message of another publisher, or one after a lost message, is a fault and is not passed on.
        """
        many = kind is NodeStatus  # every node publishes it
        self._subscribe(TOPIC_OF[kind], class_of(kind), qos_of(kind), handle, partners, counted=not many)

    def _subscribe(
        self,
        topic: str,
        message_class: Any,
        qos: QoSProfile,
        handle: Callable[[bytes], None],
        partners: tuple[str, ...],
        *,
        counted: bool = True,
    ) -> None:
        due = 1

        def received(cdr: bytes, info: Any) -> None:
            nonlocal due
            number = info["publication_sequence_number"]  # of the publisher, from 1; None: not known
            try:
                if counted and number is not None and number != due:
                    raise ProtocolError(
                        f"{topic}: message number {number} of its publisher came where number {due} is due; "
                        "one was lost, or another node publishes: give every run a ROS_DOMAIN_ID of its own"
                    )
                due += 1
                handle(cdr)
            except ProtocolError:
                count = subscription.get_publisher_count()
                self._refuse_unknown_publishers(subscription.topic_name, partners, count)  # names them
                raise

        subscription = self.create_subscription(message_class, topic, self._guarded(received), qos, raw=True)
        self._partners.append(_Endpoint(subscription, lambda: partners))

    def _subscribe_to_known(self) -> None:
        """Subscribe to the sources that have been heard of since, as they publish."""
        for source in self._sources[:]:
            kind, node = source.kind, source.node
            batches = self.heartbeat.takes_batches(node)
            if batches is None:
                continue
            self._sources.remove(source)
            if batches:
                self._guarded_topics[self.resolve_topic_name(TOPIC_OF[kind])] = (node,)
                self._subscribe(
                    batch_topic(kind),
                    rclpy_class(BATCH),
                    LOCKSTEP_QOS,
                    source.take_batch,
                    (node,),
                )
            else:
                self.listen_raw(kind, source.take_single, (node,))

    def publisher(self, kind: type, partners: tuple[str, ...]) -> Publisher:
        """Create a publisher of records of `kind`; tick 0 waits until the `partners` have subscribed."""
        partners = self._of_run(partners)
        return self._publisher(kind, lambda: partners)

    def tick_publisher(self, kind: type, at_once: tuple[str, ...], later: tuple[str, ...]) -> TickPublisher:
        """Create a publisher of records of `kind`, one a tick; tick 0 waits until all nodes have subscribed.

        at_once: nodes that take each message. later: nodes that take batches, if they can.
        """
        later = self._of_run(later)
        takes = self.heartbeat.takes_batches
        batches = self.create_publisher(rclpy_class(BATCH), batch_topic(kind), LOCKSTEP_QOS)
        self._partners.append(
            _Endpoint(batches, lambda: tuple(name for name in later if takes(name) is not False))
        )
        singles = self._publisher(
            kind, lambda: at_once + tuple(name for name in later if takes(name) is False)
        )
        publisher = TickPublisher(singles, batches, self._batch_ticks)
        self._tick_publishers.append(publisher)
        return publisher

    def flush(self) -> None:
        """Publish the messages that are kept for a batch; the heartbeat does it while an engine computes."""
        for publisher in self._tick_publishers:
            publisher.flush()

    def _of_run(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Those of the names that take part in the run: it may have no recorder."""
        return tuple(name for name in names if name != RECORDER or RECORDER in self.run.participants)

    def _publisher(self, kind: type, names: Callable[[], tuple[str, ...]]) -> Publisher:
        publisher = self.create_publisher(class_of(kind), TOPIC_OF[kind], qos_of(kind))
        self._partners.append(_Endpoint(publisher, names))
        self._writers[kind] = writer(kind, self._communication_step_ns)
        return publisher

    def bytes_of(self, record: RunRecord) -> bytes:
        """Serialized message of a record, of a kind that the node publishes."""
        return self._writers[type(record)](record)

    @property
    def matched(self) -> bool:
        """Whether every publisher and subscription has found its partners."""
        return not self._sources and not any(self._missing(*partner) for partner in self._partners)

    def on_poll(self) -> None:
        """Check states that no message reports; called every POLL_S."""

    def on_ended(self) -> None:
        """The same once the run has ended."""

    def waits_for(self) -> str:
        """Nodes that a starting node waits for, in words; empty: none."""
        missing = {source.node for source in self._sources}
        missing = missing.union(*(self._missing(*partner) for partner in self._partners))
        return f"node {', '.join(sorted(missing))}" if missing else ""

    def say_ready(self, motions: tuple[ToolMotion, ...] = (), wrenches: tuple[ToolWrench, ...] = ()) -> None:
        """Publish READY: the first tick can be granted; with the initial exchange that other nodes need."""
        self.heartbeat.say(NodeState.READY, motions=motions, wrenches=wrenches)
        self.get_logger().info(f"ready for run '{self.run.run_id}'; waits for the first grant of {COUPLER}")

    def health(self) -> Health:
        """Values that diagnostics publish beside the rate of ticks."""
        return Health()

    def on_stop(self, stop: ExitStatus) -> None:
        """Handles a stop request; called at every poll.

        Raises:
            RunError: the node ends now.
        """
        raise stop.error()

    def on_fault(self, error: BaseException) -> None:
        """Act on an error before the node publishes its fault."""

    def fail(self, error: BaseException) -> None:
        """End the node with a fault, and publish it to the other nodes."""
        if self.ended.is_set():
            return
        reason = one_line(error)
        say_trace(error)
        self.flush()
        self.on_fault(error)
        exit_status = getattr(error, "exit_status", RunError.exit_status)
        self.heartbeat.say(NodeState.FAULT, reason, exit_status=exit_status)
        self.heartbeat.flush(LAST_WORD_S)
        self.finish(exit_status, reason)

    def finish(self, exit_status: int, reason: str = "") -> None:
        """Ends the node."""
        self.status = ExitStatus(exit_status, reason)
        log_end(self.get_logger(), self.status)
        level = Level.ERROR if exit_status else Level.OK
        self._diagnostics.publish(Health(level, reason or "the run has ended"), self.heartbeat.tick)
        self.ended.set()
        for publisher in self._tick_publishers:
            publisher.drop()

    def finish_aborted(self, grant: Grant) -> None:
        """Ends the node because the coupler aborted the run."""
        self.heartbeat.say(NodeState.ENDED)
        self.finish(RunError.exit_status, f"run aborted at tick {grant.tick}: {grant.reason}")

    def note_tick(self, tick: int, last: bool) -> None:
        """Update tick and state that the heartbeat publishes."""
        self.heartbeat.tick = tick
        if tick == self._first_tick and not last:
            self.heartbeat.say(NodeState.RUNNING)
        elif last:
            self.heartbeat.say(NodeState.ENDED)

    def follow_coupler_end(self, node_status: NodeStatus) -> None:
        """End the node, whose work is done, when the coupler has published ENDED."""
        if (
            node_status.node == COUPLER
            and node_status.state is NodeState.ENDED
            and node_status.run_id == self.run.run_id
        ):
            self.finish(0)

    def _missing(
        self, endpoint: Publisher | Subscription, names_of: Callable[[], tuple[str, ...]]
    ) -> set[str]:
        """Partners that an endpoint has not found yet."""
        names = names_of()
        if isinstance(endpoint, Subscription):
            return set(names) if endpoint.get_publisher_count() < len(names) else set()
        listeners = self.get_subscriptions_info_by_topic(endpoint.topic_name)
        # an unknown node may listen too; one with durability transient_local is never matched
        can_match = [
            item.node_name for item in listeners if item.qos_profile.durability == DurabilityPolicy.VOLATILE
        ]
        if endpoint.get_subscription_count() < len(can_match):
            return set(names)
        return set(names) - set(can_match)

    def _poll(self) -> None:
        stop = self.heartbeat.stop
        if stop is not None:
            self.on_stop(stop)
        if self.heartbeat.lost and self.heartbeat.state is NodeState.ENDED:
            self.finish(0)  # its work is done, nothing is lost
            return
        if self.heartbeat.lost:
            raise RunError(self.heartbeat.lost)
        self._refuse_other_publishers()
        self._subscribe_to_known()
        self.flush()
        self.on_poll()
        if self.heartbeat.state is NodeState.STARTING:
            self._log_waiting()
        if time.monotonic() >= self._diagnostics.due_s:
            self._diagnostics.publish(self.health(), self.heartbeat.tick)

    def _log_waiting(self) -> None:
        now = time.monotonic()
        if now < self._next_waiting:
            return
        self._next_waiting = now + WAITING_S
        words = self.waits_for()
        if words and words != self._waited_for:
            self.get_logger().info(f"waits for {words} of run '{self.run.run_id}'")
        self._waited_for = words

    def _refuse_other_publishers(self) -> None:
        """Raises ProtocolError if a lockstep topic has more publishers than the run."""
        for endpoint, names_of in self._partners:
            if not isinstance(endpoint, Subscription) or endpoint.topic_name.endswith(TOPIC_OF[NodeStatus]):
                continue  # every node publishes its status
            if (count := endpoint.get_publisher_count()) > len(names_of()):
                self._refuse_unknown_publishers(endpoint.topic_name, names_of(), count)
        for topic, names in self._guarded_topics.items():
            if (count := self.count_publishers(topic)) > len(names):
                self._refuse_unknown_publishers(topic, names, count)

    def _refuse_unknown_publishers(self, topic: str, names: tuple[str, ...], count: int) -> None:
        """Raises ProtocolError that names those of `count` publishers which are not of the run, if any."""
        if topic.endswith(TOPIC_OF[NodeStatus]):
            run = (*self.run.participants, COUPLER)
            names = tuple(f"{name}_process" for name in run)
            allowed = {*names, *run}  # a controller in another language may be one node
        else:
            allowed = set(names)
        found = unknown_publishers(self, topic, allowed.__contains__, count)
        if found:
            raise ProtocolError(
                f"{topic.lstrip('/')}: {found} publishes on it; in a run only {', '.join(names)} may. Give "
                "every run a ROS_DOMAIN_ID of its own"
            )

    def _guarded(self, handle: Callable[..., None], *, after_end: bool = False) -> Callable[..., None]:
        """Wrap a callback so that its errors become the node's fault.

        after_end: also called once the run has ended.
        """

        def guarded(*arguments: Any) -> None:
            if self.ended.is_set() and not after_end:
                return
            try:
                handle(*arguments)
            except Exception as error:  # a node's fault ends the run of all: it is reported, not swallowed
                self.fail(error)

        return guarded
