"""Strangers on our topics, and what only looks like a fault; nodes in one process with small engines."""

import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rclpy.node import Node
from subsoil_msgs import msg
from subsoil_msgs.msg import ToolWrench as ToolWrenchMessage
from subsoil_msgs.msg import ToolWrenches as ToolWrenchesMessage

from subsoil_ros.coupling.exit_status import ExitStatus
from subsoil_ros.coupling.protocol import ACK_LAG_TICKS, COUPLER, RECORDER
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import Grant, NodeStatus, ToolMotion, ToolWrench
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.ros.nodes.composed import run_composed
from subsoil_ros.ros.nodes.recorder_node import RecorderNode
from subsoil_ros.ros.process import heartbeat as lifeline_module
from subsoil_ros.ros.transport.qos import LOCKSTEP_QOS, NODE_STATUS_QOS, qos_of
from tests.system.conftest import SCENE, lockstep_ticks
from tests.system.test_conventions import spin
from tests.system.test_nodes import (  # noqa: F401  fixtures
    LIMIT_S,
    TICKS,
    GatedSoil,
    SpringMover,
    SpringSoil,
    _own_domain,
    builds,
    listener,
    resolved,
    run_nodes,
    status_with_unknown_publisher,
)
from tests.system.test_pause import start


def wrong_tick(message: ToolWrenchesMessage) -> None:
    """A tick that was not granted."""
    message.tick += 1000


def not_a_number(message: ToolWrenchesMessage) -> None:
    """A force that is none."""
    message.tools[0].wrench.force.x = math.nan


def too_many_tools(message: ToolWrenchesMessage) -> None:
    """A tool that the scene does not have."""
    message.tools.append(ToolWrenchMessage(tool="spoon"))


@pytest.mark.parametrize("spoil", [wrong_tick, not_a_number, too_many_tools])
def test_an_unknown_publisher_is_refused_by_name(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
    spoil: Callable[[ToolWrenchesMessage], None],
) -> None:
    """Wrenches of our run, but not of our soil: exit 3, the topic named, no tick of the record his.

    The message stands where the soil's own answer to tick 3 belongs.
    """
    (tool,) = resolved.scene.tools
    message = ToolWrenchesMessage(run_id="test", tick=3, tools=[ToolWrenchMessage(tool=tool)])
    message.header.stamp.nanosec = 4 * resolved.timing.communication_step_ns
    spoil(message)
    status = status_with_unknown_publisher(resolved, tmp_path / "bag", listener, "tool_wrenches", message)
    assert status.code == 3
    expected = "tool_wrenches: node '/stranger' on this machine publishes on it; in a run only soil may"
    assert expected in status.reason
    ticks = lockstep_ticks(tmp_path / "bag", resolved.timing.communication_step_ns)
    count = len(ticks["grant"])  # who finds him ends with what all had finished, or with what it had
    assert count <= 3
    assert ticks == {name: list(range(count)) for name in ticks}


def of_run(kind: type, run_id: str = "test") -> Any:
    """A message whose content a node would refuse: of tick 3, before any is granted."""
    message = kind(run_id=run_id, tick=3)
    message.header.stamp.nanosec = 4 * 48_000
    return message


@pytest.mark.parametrize(
    ("topic", "message", "owners"),
    [
        ("grant", of_run(msg.Grant), "coupler"),
        ("tool_motions", of_run(msg.ToolMotions), "mechanism"),
        ("tool_wrenches", of_run(msg.ToolWrenches), "soil"),
        ("mechanism_state", of_run(msg.MechanismState), "mechanism"),
        ("tick_ack", of_run(msg.TickAck), "recorder"),
        ("node_status", msg.NodeStatus(run_id="other", node="soil"), "mechanism_process, soil_process, "),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_it_is_named_while_the_run_is_paused(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
    topic: str,
    message: Any,
    owners: str,
) -> None:
    """By one form of message for every topic: topic, node, machine, and whose topic it is."""
    states: list[int] = []

    def heard(status: msg.NodeStatus) -> None:
        if status.node == COUPLER:
            states.append(status.state)

    listener.create_subscription(msg.NodeStatus, "node_status", heard, NODE_STATUS_QOS)
    thread, statuses = start(resolved, tmp_path / "bag")
    spin(listener, lambda: states and states[-1] == msg.NodeStatus.PAUSED)
    qos = qos_of(NodeStatus if topic == "node_status" else Grant)
    publisher = listener.create_publisher(type(message), topic, qos)
    spin(listener, lambda: publisher.get_subscription_count() or statuses)  # grants have no listener
    publisher.publish(message)
    thread.join(LIMIT_S)
    (status,) = statuses
    assert status.code == 3
    expected = f"{topic}: node '/stranger' on this machine publishes on it; in a run only {owners}"
    assert expected in status.reason
    assert status.reason.endswith(" may. Give every run a ROS_DOMAIN_ID of its own")


def test_a_listener_that_takes_nothing_holds_nobody_up(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
) -> None:
    """A node subscribes to a lockstep topic and never reads: the run ends well, all is recorded."""
    listener.create_subscription(ToolWrenchesMessage, "tool_wrenches", print, LOCKSTEP_QOS)
    assert run_nodes(resolved, tmp_path / "bag", SpringSoil) == ExitStatus()
    ticks = lockstep_ticks(tmp_path / "bag", resolved.timing.communication_step_ns)
    assert ticks == {name: list(range(TICKS)) for name in ticks}


class SlowSoil(SpringSoil):
    """Takes its time for one tick."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._seconds = seconds

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        if tick == 5:
            time.sleep(self._seconds)
        return super().advance(tick, motions)


def test_a_long_tick_is_no_fault(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A tick that takes longer than any silence is borne: heartbeats go on meanwhile."""
    monkeypatch.setattr(lifeline_module, "SILENCE_S", 1.0)
    monkeypatch.setattr(lifeline_module, "STALL_S", 1.0)
    assert run_nodes(resolved, tmp_path / "bag", lambda: SlowSoil(2.5)) == ExitStatus()


def test_a_slow_disk_holds_the_run_and_loses_nothing(tmp_path: Path) -> None:
    """The writer takes 1 ms a message: the soil is held ACK_LAG_TICKS ahead of it, all is recorded."""
    ticks = 3 * ACK_LAG_TICKS
    slow = load_scene(SCENE, ["coupling.communication_step_ns=48000", f"duration_s={ticks * 48e-6}"])
    (tool,) = slow.scene.tools
    leads: list[int] = []
    soil_tick = [-1]

    class SlowWriter(BagWriter):
        def write_raw(self, topic: str, tick: int, cdr: bytes) -> None:
            time.sleep(1e-3)
            leads.append(soil_tick[0] - tick)
            super().write_raw(topic, tick, cdr)

    class CountingSoil(SpringSoil):
        def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
            soil_tick[0] = tick
            return super().advance(tick, motions)

    nodes = builds(slow, tmp_path / "bag", partial(SpringMover, tool), CountingSoil)
    writer = SlowWriter(tmp_path / "bag", slow.scene, slow.timing)
    nodes[RECORDER] = lambda run, heartbeat, context: RecorderNode(writer, run, heartbeat, context)
    assert run_composed(RunSettings(slow, "test"), nodes) == ExitStatus()
    assert ACK_LAG_TICKS // 2 < max(leads) <= ACK_LAG_TICKS
    recorded = lockstep_ticks(tmp_path / "bag", slow.timing.communication_step_ns)
    assert recorded == {name: list(range(ticks)) for name in recorded}
