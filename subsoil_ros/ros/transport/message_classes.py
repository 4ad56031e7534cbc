"""rclpy's classes of messages, for the declaration of topics.

Nodes publish and receive the bytes of recording/message_codec.py, as the direct run records them: the bags of
all modes contain the same bytes.
"""

from functools import cache
from importlib import import_module
from typing import Any

from ...recording.types import message_type


@cache
def rclpy_class(name: str) -> Any:
    """Class of a message type, "subsoil_msgs/msg/Grant"."""
    package, _, short = name.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), short)


def class_of(kind: type) -> Any:
    """Class of the message that carries records of `kind`."""
    return rclpy_class(message_type(kind))
