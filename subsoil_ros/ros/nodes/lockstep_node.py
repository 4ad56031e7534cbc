"""What the nodes of a run have in common: their readiness, their end, and that no error is lost."""

import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.subscription import Subscription

from ...coupling.exit_status import ExitStatus
from ...coupling.protocol import COUPLER, RECORDER
from ...errors import ProtocolError, RunError, SubsoilError
from ...messages import Grant, NodeState, NodeStatus
from ...recording.topics import TOPIC_OF
from ..process.heartbeat import Heartbeat, NodeRun
from ..services.diagnostics import Diagnostics, Health, Level
from ..transport.convert import class_of, reader, writer
from ..transport.qos import qos_of
from .message_loop import serve

POLL_S = 0.1
"""How often a node checks what no message brings: matched endpoints, stop requests, silence."""

LONGEST_REST_S = 0.05
"""Longest time that a stop request can wait while the node sleeps."""

NAME_TRIES = 10
"""Looks, POLL_S apart, for the name of a node whose publisher was found (chosen: a second)."""

_UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""What rmw calls such a node."""

_MEASURED, _RECENT = 101, 4
"""Wake-ups whose tick times are kept, and those of them that the rest follows (chosen)."""

OWN_TIME = [Parameter("use_sim_time", value=False)]
"""These nodes make the simulated time: none follows /clock, whatever use_sim_time says to others."""

LAST_WORD_S = 1.5
"""Time given to a last message to arrive; it is used up if somebody is dead."""


def one_line(error: BaseException) -> str:
    """An error as a message of one line; unexpected kinds with their name."""
    text = " ".join(str(error).split())
    return text if isinstance(error, SubsoilError) and text else f"{type(error).__name__}: {text}"


class LockstepNode(Node):
    """A node of a run. Subclasses add topics, `on_poll` and `on_coupler_end`.

    Everything runs in the one thread that calls `spin`. An error in a callback is the node's fault: it is
    said in a NodeStatus, and the node ends with the error's exit status.
    """

    rest_s = 0.0
    rest_ticks = 0
    """Pause after every wake-up, the longer of both; for nodes that nobody waits for. Each wake-up finds cold
    caches, pushes a thread that computes aside, and takes two thirds less if it is shared."""

    def __init__(self, name: str, run: NodeRun, heartbeat: Heartbeat, context: Context | None = None) -> None:
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
        self._communication_step_ns = run.resolved.timing.communication_step_ns
        self._writers: dict[type, Callable[[Any], bytes]] = {}
        self._partners: list[tuple[Publisher | Subscription, tuple[str, ...]]] = []
        self._diagnostics = Diagnostics(self, run.run_id, self._communication_step_ns)
        self._woken = run.first_tick, time.monotonic()  # the last tick at the last wake-up, and when
        self.tick_times_s: deque[float] = deque(maxlen=_MEASURED)
        """Of the last wake-ups, the mean time of a tick between one and the next."""

    def spin(self) -> None:
        """Serves until the node ends."""
        serve(self, self._guarded(self._poll), POLL_S, self.ended.is_set, self._pause_s)

    def discount_wait(self) -> None:
        """The time up to now was not taken by ticks: nobody asked for any."""
        self._woken = self.heartbeat.tick, time.monotonic()

    def _pause_s(self) -> float:
        tick, (last_tick, last) = self.heartbeat.tick, self._woken
        if tick > last_tick:
            self.tick_times_s.append((time.monotonic() - last) / (tick - last_tick))
            self.discount_wait()
        # the least of some: one of them may hold a wait for somebody who keeps real time
        tick_s = min(list(self.tick_times_s)[-_RECENT:], default=0.0)
        return min(max(self.rest_s, self.rest_ticks * tick_s), LONGEST_REST_S)

    def listen(self, kind: type, handle: Callable[[Any], None], partners: tuple[str, ...]) -> None:
        """Hands records of `kind`, from the nodes named, to `handle`."""

        read = reader(kind, self._communication_step_ns)
        self.listen_raw(kind, lambda cdr: handle(read(cdr)), partners)

    def listen_raw(self, kind: type, handle: Callable[[bytes], None], partners: tuple[str, ...]) -> None:
        """Hands the CDR bytes of records of `kind`, from the nodes named, to `handle`.

        What does not come from them, or comes after a loss, is a fault before anybody sees it.
        """
        topic = TOPIC_OF[kind]
        due = 1

        def received(cdr: bytes, info: Any) -> None:
            nonlocal due
            number = info["publication_sequence_number"]  # of the publisher, from 1; None: not known
            many = kind is NodeStatus  # every node publishes it
            if not many and number is not None and number != due:
                raise ProtocolError(
                    f"{topic}: message number {number} of its publisher came where number {due} is due; "
                    "one was lost, or somebody else publishes: give every run a ROS_DOMAIN_ID of its own"
                )
            due += 1
            handle(cdr)

        subscription = self.create_subscription(
            class_of(kind), topic, self._guarded(received), qos_of(kind), raw=True
        )
        self._partners.append((subscription, partners))

    def publisher(self, kind: type, partners: tuple[str, ...]) -> Publisher:
        """A publisher of records of `kind` that the nodes named must be listening to before tick 0."""
        publisher = self.create_publisher(class_of(kind), TOPIC_OF[kind], qos_of(kind))
        if RECORDER not in self.run.participants:
            partners = tuple(name for name in partners if name != RECORDER)
        self._partners.append((publisher, partners))
        self._writers[kind] = writer(kind, self._communication_step_ns)
        return publisher

    def bytes_of(self, record: Any) -> bytes:
        """The message of a record of a kind that the node publishes, ready to be published."""
        return self._writers[type(record)](record)

    @property
    def matched(self) -> bool:
        """Whether every publisher and subscription has found its partners."""
        return all(self._has_found(endpoint, names) for endpoint, names in self._partners)

    def on_poll(self) -> None:
        """Looks after what no message brings."""

    def health(self) -> Health:
        """What diagnostics say of the node beside its rate."""
        return Health()

    def on_stop(self, stop: ExitStatus) -> None:
        """Handles a stop request; called at every poll.

        Raises:
            RunError: it ends now.
        """
        raise stop.error()

    def on_fault(self, error: BaseException) -> None:
        """Does what must be done before the node's fault is said."""

    def fail(self, error: BaseException) -> None:
        """Ends the node with a fault that the others hear of."""
        if self.ended.is_set():
            return
        reason = one_line(error)
        if not isinstance(error, SubsoilError):
            self.get_logger().error("".join(traceback.format_exception(error)))
        self.on_fault(error)
        exit_status = getattr(error, "exit_status", RunError.exit_status)
        self.heartbeat.say(NodeState.FAULT, reason, exit_status=exit_status)
        self.heartbeat.flush(LAST_WORD_S)
        self.finish(exit_status, reason)

    def finish(self, exit_status: int, reason: str = "") -> None:
        """Ends the node."""
        self.status = ExitStatus(exit_status, reason)
        level = Level.ERROR if exit_status else Level.OK
        self._diagnostics.publish(Health(level, reason or "the run has ended"), self.heartbeat.tick)
        self.ended.set()

    def finish_aborted(self, grant: Grant) -> None:
        """Ends the node because the coupler aborted the run."""
        self.heartbeat.say(NodeState.ENDED)
        self.finish(RunError.exit_status, f"run aborted at tick {grant.tick}: {grant.reason}")

    def note_tick(self, tick: int, last: bool) -> None:
        """Lets the heartbeat say how far the node is."""
        self.heartbeat.tick = tick
        if tick == self.run.first_tick and not last:
            self.heartbeat.say(NodeState.RUNNING)
        elif last:
            self.heartbeat.say(NodeState.ENDED)

    def follow_coupler_end(self, node_status: NodeStatus) -> None:
        """Ends the node, its work being done, when the coupler says that the run is over."""
        if (
            node_status.node == COUPLER
            and node_status.state is NodeState.ENDED
            and node_status.run_id == self.run.run_id
        ):
            self.finish(0)

    def _has_found(self, endpoint: Publisher | Subscription, names: tuple[str, ...]) -> bool:
        if isinstance(endpoint, Subscription):
            return endpoint.get_publisher_count() >= len(names)
        listeners = self.get_subscriptions_info_by_topic(endpoint.topic_name)
        # somebody else may listen too; who asks for kept messages is never matched
        can_match = [
            item.node_name for item in listeners if item.qos_profile.durability == DurabilityPolicy.VOLATILE
        ]
        return set(can_match).issuperset(names) and endpoint.get_subscription_count() >= len(can_match)

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
        self.on_poll()
        if self._diagnostics.due():
            self._diagnostics.publish(self.health(), self.heartbeat.tick)

    def _refuse_other_publishers(self) -> None:
        """Raises ProtocolError if a lockstep topic has more publishers than the run."""
        for endpoint, names in self._partners:
            if not isinstance(endpoint, Subscription) or endpoint.topic_name.endswith(TOPIC_OF[NodeStatus]):
                continue  # every node publishes its status
            count = endpoint.get_publisher_count()
            if count > len(names):
                found = ", ".join(self._publishers_of(endpoint.topic_name, count))
                raise ProtocolError(
                    f"{endpoint.topic_name.lstrip('/')}: published by the nodes {found}; in a run it comes "
                    f"from {', '.join(names)} alone. Give every run a ROS_DOMAIN_ID of its own"
                )

    def _publishers_of(self, topic: str, count: int) -> list[str]:
        """Names of the nodes of its `count` publishers, who are heard of a little later than these."""
        for _ in range(NAME_TRIES):
            names = sorted(info.node_name for info in self.get_publishers_info_by_topic(topic))
            if len(names) >= count and _UNKNOWN not in names:
                break
            time.sleep(POLL_S)
        names += [_UNKNOWN] * (count - len(names))
        return ["a node not heard of yet" if name == _UNKNOWN else name for name in names]

    def _guarded(self, handle: Callable[..., None]) -> Callable[..., None]:
        def guarded(*arguments: Any) -> None:
            if self.ended.is_set():
                return
            try:
                handle(*arguments)
            except Exception as error:  # a node's fault is everybody's: it is said, not swallowed
                self.fail(error)

        return guarded
