"""Health of a node for diagnostic tools: /diagnostics, about once a second of wall time.

A node publishes values that it already has, in its own thread: no engine computes any, no node waits for it.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from rclpy.node import Node

from ...coupling.time_limits import DIAGNOSTICS_S
from ...recording.standard_messages import stamp
from ...recording.types import message_class, serialize
from ...ticks import INITIAL_TICK, tick_end_s
from ..transport.qos import VISUALIZATION_QOS, rclpy_class

TOPIC = "/diagnostics"  # of all nodes of a system (diagnostic_updater); the status names tell them apart
_KIND = "diagnostic_msgs/msg/DiagnosticArray"


class Level(IntEnum):
    """Values of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Health:
    """Health of a node; units stand in the names of the values."""

    level: Level = Level.OK
    message: str = ""
    values: Mapping[str, str | float | int] = field(default_factory=dict)


class Diagnostics:
    """Publishes a node's health. Stamps are wall time: rates and delays are of this machine."""

    def __init__(self, node: Node, run_id: str, communication_step_ns: int, task: str = "lockstep") -> None:
        self._publisher = node.create_publisher(rclpy_class(_KIND), TOPIC, VISUALIZATION_QOS)
        self._name = f"{node.get_fully_qualified_name().lstrip('/')}: {task}"
        self._run_id = run_id
        self._communication_step_ns = communication_step_ns
        self._last_s = time.monotonic()
        self.due_s = self._last_s + DIAGNOSTICS_S
        """When the next message is due, as time.monotonic gives it."""
        self._last_tick: int | None = None  # None: nothing is done yet

    def publish(self, health: Health, tick: int) -> None:
        """Publish the health of the node after `tick`, the last one that it has finished."""
        now = time.monotonic()
        rate_hz = 0.0
        if self._last_tick is not None and now > self._last_s:
            rate_hz = (tick - self._last_tick) / (now - self._last_s)
        self._last_s, self._last_tick = now, tick
        self.due_s = now + DIAGNOSTICS_S
        values = {
            "tick": tick,
            "simulated_time_s": tick_end_s(tick, self._communication_step_ns) if tick > INITIAL_TICK else 0.0,
            "ticks_per_s": rate_hz,
            "real_time_factor": rate_hz * self._communication_step_ns * 1e-9,
            **health.values,
        }
        key_value = message_class("diagnostic_msgs/msg/KeyValue")
        status = message_class("diagnostic_msgs/msg/DiagnosticStatus")(
            level=int(health.level),
            name=self._name,
            message=health.message or f"at tick {tick}",
            hardware_id=self._run_id,
            values=[key_value(key=key, value=_text(value)) for key, value in values.items()],
        )
        header = message_class("std_msgs/msg/Header")(stamp=stamp(time.time_ns()), frame_id="")
        self._publisher.publish(serialize(message_class(_KIND)(header=header, status=[status])))


def _text(value: str | float | int) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
