"""Records of messages.py to serialized messages and back; float64 values are only copied.

Nodes publish and receive CDR bytes of the serializer that the direct run uses: the bags of all modes contain
the same bytes. This takes a third of the time of rclpy's own conversion.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

from ...recording.conversion import from_message, message_type, to_message
from ...recording.types import deserialize, serialize
from .tick_codec import TICKED, TickCodec


@cache
def rclpy_class(name: str) -> Any:
    """rclpy's class of a message type, "subsoil_msgs/msg/Grant", for the declaration of a topic."""
    package, _, short = name.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), short)


def class_of(kind: type) -> Any:
    """rclpy's class of the message that carries records of `kind`."""
    return rclpy_class(message_type(kind))


def writer(kind: type, communication_step_ns: int) -> Callable[[Any], bytes]:
    """Return the function that converts records of `kind` to CDR bytes."""
    if kind in TICKED:
        return TickCodec(kind, communication_step_ns).encode
    return lambda record: to_bytes(record, communication_step_ns)


def to_bytes(record: Any, communication_step_ns: int) -> bytes:
    """CDR of the message that carries `record`."""
    return serialize(to_message(record, communication_step_ns))


def reader(kind: type, communication_step_ns: int) -> Callable[[bytes], Any]:
    """Return the function that converts CDR bytes to records of `kind`."""
    if kind in TICKED:
        return TickCodec(kind, communication_step_ns).decode
    name = message_type(kind)
    return lambda cdr: from_message(kind, deserialize(cdr, name))
