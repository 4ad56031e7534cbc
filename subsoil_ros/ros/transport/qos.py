"""Class and quality of service of the messages of every topic."""

from functools import cache
from importlib import import_module
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ...coupling.protocol import ACK_LAG_TICKS
from ...messages import NodeStatus, SoilCloud
from ...recording.topics import LOCKSTEP_DEPTH
from ...recording.types import message_type

RosMessage = Any
"""A message of rclpy, a request, a response or its header, or the class of one: made at run time."""


@cache
def rclpy_class(name: str) -> RosMessage:
    """Class of a message type, "subsoil_msgs/msg/Grant"."""
    package, _, short = name.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), short)


def class_of(kind: type) -> RosMessage:
    """Class of the message that carries records of `kind`."""
    return rclpy_class(message_type(kind))


def _reliable(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
    )


LOCKSTEP_QOS = _reliable(LOCKSTEP_DEPTH)
"""Lockstep messages and the states recorded with them. The recorder is never further behind than
ACK_LAG_TICKS, so nothing leaves the history before it has arrived.

Volatile: no endpoint joins late, as all are matched before tick 0. A history for late joiners is always full,
and Fast DDS then requests an acknowledgement of every reader with every message.
"""

NODE_STATUS_QOS = _reliable(50, DurabilityPolicy.TRANSIENT_LOCAL)
"""One queue receives the status of all nodes, so it must hold several of each."""

CLOUD_QOS = _reliable(ACK_LAG_TICKS + 1)
"""Volatile: a cloud is freed as soon as its readers have it. Deep enough for one cloud per tick."""

VISUALIZATION_QOS = _reliable(10)
"""Poses, wrenches, /tf and /clock: live, for any listener; the recorder derives its own for the bag."""

LATCHED_QOS = _reliable(1, DurabilityPolicy.TRANSIENT_LOCAL)
"""Messages published once and kept for late joiners: the machine's description, its tools."""


def qos_of(kind: type) -> QoSProfile:
    """The quality of service for records of `kind`, for publishers and subscriptions."""
    return {NodeStatus: NODE_STATUS_QOS, SoilCloud: CLOUD_QOS}.get(kind, LOCKSTEP_QOS)
