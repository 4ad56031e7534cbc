"""Heartbeat of a node, and supervision of the other nodes, in a thread of its own.

The thread runs while an engine computes: compiled kernels release the GIL.
"""

import os
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import replace

import psutil
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ..._version import __version__
from ...coupling.exit_status import ExitStatus
from ...coupling.protocol import BATCHES, CAPABILITIES, COUPLER
from ...coupling.run_settings import RunSettings
from ...coupling.time_limits import HEARTBEAT_S, SILENCE_S, STALL_S, STARTUP_S
from ...messages import NodeState, NodeStatus, ToolMotion, ToolWrench
from ...recording.message_codec import reader, writer
from ...recording.topics import TOPIC_OF
from ...recording.types import own_type_hashes
from ...ticks import INITIAL_TICK
from ..transport.private_rclpy import ParameterServices
from ..transport.qos import NODE_STATUS_QOS, class_of


def first_status(run: RunSettings, node: str) -> NodeStatus:
    """The status of a node as it starts."""
    return NodeStatus(
        run.run_id,
        node,
        NodeState.STARTING,
        run.resolved.scene_hash,
        __version__,
        own_type_hashes(),
        CAPABILITIES.get(node, ()),
        os.getpid(),
        INITIAL_TICK,
    )


class Heartbeat:
    """Publishes the status of a node, and detects which of the watched nodes are silent.

    Args:
        node: a ROS node used only here, and spun here.
        name: name of the node whose status is published.
        watched: names of the nodes whose status is received.
    """

    def __init__(self, node: Node, name: str, run: RunSettings, watched: tuple[str, ...]) -> None:
        self.tick = INITIAL_TICK  # last tick the node has finished, for the next heartbeat
        self.stop: ExitStatus | None = None  # a stop request
        self._node = node
        self.run = run
        self._node_status = first_status(run, name)
        self._watched = watched
        now = time.monotonic()
        self._started = self._checked = now
        self._heard: dict[str, float] = {}
        self._process_ids: dict[str, int] = {}
        self._was_here: dict[str, bool] = {}  # whether that process was on this machine when first heard of
        self._capabilities: dict[str, tuple[str, ...]] = {}
        self._ended: dict[str, tuple[float, str]] = {}  # when a node published its end, and why
        self._lost = ""
        self._said = threading.Lock()
        node_status_class = class_of(NodeStatus)
        self._publisher = node.create_publisher(node_status_class, TOPIC_OF[NodeStatus], NODE_STATUS_QOS)
        self._subscription = node.create_subscription(
            node_status_class, TOPIC_OF[NodeStatus], self._on_node_status, NODE_STATUS_QOS, raw=True
        )
        self._read = reader(NodeStatus)
        self._write = writer(NodeStatus, run.resolved.timing.communication_step_ns)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(HEARTBEAT_S, self._on_timer, clock=steady)
        self._parameters = ParameterServices(node, name)
        self._closing = threading.Event()
        self._destroys: list[Callable[[], None]] = []
        self._at_beat: Callable[[], None] = lambda: None
        self._thread = threading.Thread(target=self._spin, name=f"{name}_heartbeat", daemon=True)

    def start(self) -> None:
        """Begin to publish and to receive."""
        self._publish()
        self._thread.start()

    def say(
        self,
        state: NodeState,
        message: str = "",
        motions: tuple[ToolMotion, ...] = (),
        wrenches: tuple[ToolWrench, ...] = (),
        exit_status: int = 0,
    ) -> None:
        """Change the status of the node, and publish it at once."""
        self._node_status = replace(
            self._node_status,
            state=state,
            message=message,
            initial_motions=motions,
            initial_wrenches=wrenches,
            exit_status=exit_status,
        )
        self._publish()

    @property
    def node(self) -> Node:
        """The ROS node that is spun here."""
        return self._node

    @property
    def state(self) -> NodeState:
        """The state published last."""
        return self._node_status.state

    @property
    def lost(self) -> str:
        """The watched node that is silent or a coupler that has ended, in words; empty if there is none."""
        return self._lost

    def takes_batches(self, node: str) -> bool | None:
        """Whether a node of the run has the capability BATCHES; None: not heard of yet."""
        found = self._capabilities.get(node)
        return None if found is None else BATCHES in found

    def request_stop(self, stop: ExitStatus) -> None:
        """Request the node to end; the first request counts. For any thread or signal handler."""
        if self.stop is None:
            self.stop = stop

    def flush(self, timeout_s: float) -> None:
        """Wait until the last status has arrived."""
        self._publisher.wait_for_all_acked(Duration(seconds=timeout_s))

    @property
    def untold(self) -> tuple[str, ...]:
        """Watched nodes that have neither published their end nor are silent."""
        now = time.monotonic()
        return tuple(
            name
            for name in self._watched
            if name not in self._ended and now - self._heard.get(name, now) <= SILENCE_S
        )

    def outlast(self, limit_s: float, names: Collection[str] | None = None) -> None:
        """Keep publishing until the watched nodes (only those in `names`, if given) have ended or are silent.

        limit_s: longest time to wait.
        """
        deadline = time.monotonic() + limit_s
        waited = set(self._watched if names is None else names)
        while waited & set(self.untold) and self.stop is None and time.monotonic() < deadline:
            time.sleep(0.1)

    def at_beat(self, act: Callable[[], None]) -> None:
        """Register a function that is called with every heartbeat."""
        self._at_beat = act

    def at_close(self, destroy: Callable[[], None]) -> None:
        """Register a function that destroys an entity of the node once it is not spun any more."""
        self._destroys.append(destroy)

    def close(self) -> None:
        """Stop publishing and destroy the node."""
        self._closing.set()
        self._thread.join()
        for destroy in self._destroys:
            destroy()
        self._node.destroy_node()

    def _spin(self) -> None:
        executor = SingleThreadedExecutor(context=self._node.context)
        executor.add_node(self._node)
        while not self._closing.is_set():
            executor.spin_once(timeout_sec=HEARTBEAT_S)
        executor.shutdown()

    def _publish(self) -> None:
        with self._said:
            self._node_status = replace(self._node_status, tick=self.tick)
            self._publisher.publish(self._write(self._node_status))

    def _on_node_status(self, cdr: bytes) -> None:
        node_status = self._read(cdr)
        if node_status.run_id == self.run.run_id:
            self._capabilities[node_status.node] = node_status.capabilities
        else:  # its messages, of another run, are refused
            self._capabilities.setdefault(node_status.node, node_status.capabilities)
        if node_status.run_id == self.run.run_id and node_status.node in self._watched:
            self._heard[node_status.node] = time.monotonic()
            if self._process_ids.get(node_status.node) != node_status.process_id:
                self._process_ids[node_status.node] = node_status.process_id
                self._was_here[node_status.node] = _lives(node_status.process_id)
            if node_status.state in (NodeState.ENDED, NodeState.FAULT):
                self._ended.setdefault(node_status.node, (time.monotonic(), node_status.message))

    def _on_timer(self) -> None:
        self._publish()
        self._at_beat()
        now = time.monotonic()
        if now - self._checked > 0.5 * SILENCE_S:  # this process itself was stopped: the others may run
            self._heard = dict.fromkeys(self._heard, now)
        self._checked = now
        for name in self._watched:
            if self._lost:
                return
            ended = self._ended.get(name)
            if ended is not None:
                since, reason = ended
                if name == COUPLER and now - since > SILENCE_S:  # without it no grant can come
                    self._lost = f"{name} has ended" + (f": {reason}" if reason else "")
                continue
            heard = self._heard.get(name)
            if heard is None and now - self._started > STARTUP_S:
                self._lost = f"{name} was not heard of within {STARTUP_S:g} s"
            elif heard is not None and now - heard > self._patience_s(name, now - heard):
                self._lost = f"{name} has not been heard of for {now - heard:.1f} s"

    def _patience_s(self, name: str, silence_s: float) -> float:
        if silence_s < SILENCE_S:
            return SILENCE_S
        gone = self._was_here[name] and not _lives(self._process_ids[name])
        return SILENCE_S if gone else STALL_S


def _lives(process_id: int) -> bool:
    """Whether a process of this machine has that number and has not ended."""
    try:
        return psutil.Process(process_id).status() not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
    except psutil.NoSuchProcess:
        return False
