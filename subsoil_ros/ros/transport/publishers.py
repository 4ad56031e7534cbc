"""Publishers of a topic: node and machine, as reported by DDS."""

import os
import time
from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

NAME_TRIES, NAME_WAIT_S = 10, 0.1
"""Number of queries for the name of a node whose publisher was found, and time between them: names come
later, within a second."""

_UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""Name that rmw gives to a node that it has not discovered yet."""

_FAST_DDS = bytes((1, 15))
"""First bytes of identifiers of Fast DDS. After them come two of the machine and two of the process."""

_PARAMETER_EVENTS = "/parameter_events"
"""A topic on which every node publishes."""


def unknown_publishers(node: Node, topic: str, is_ours: Callable[[str], bool], matched: int) -> str:
    """Name the publishers of `topic` that are not of the run, each with its machine; empty: there are none.

    Of two nodes with one name, either may be of the run: both are named.

    Args:
        node: a node of the run.
        topic: full name of the topic.
        is_ours: whether a node of this name, in the namespace of `node`, may publish on the topic.
        matched: number of publishers that a subscription has found; their names come a little later.
    """
    found: Sequence[TopicEndpointInfo] = ()
    for _ in range(NAME_TRIES):
        found = node.get_publishers_info_by_topic(topic)
        if len(found) >= matched and all(item.node_name != _UNKNOWN for item in found):
            break
        time.sleep(NAME_WAIT_S)
    namespace = node.get_namespace()
    ours = [item.node_namespace == namespace and is_ours(item.node_name) for item in found]
    names = [_full_name(item) for item in found]
    strangers = [
        item for item, name, own in zip(found, names, ours, strict=True) if not own or names.count(name) > 1
    ]
    machine = _own_machine(node)
    return " and ".join(sorted(f"node '{_full_name(item)}'{_place(item, machine)}" for item in strangers))


def _full_name(item: TopicEndpointInfo) -> str:
    if item.node_name == _UNKNOWN:
        return "not heard of yet"
    return f"{item.node_namespace.rstrip('/')}/{item.node_name}"


def _identifier(item: TopicEndpointInfo) -> bytes:
    return bytes(item.endpoint_gid)


def _own_machine(node: Node) -> bytes:
    """Identifier of this machine in Fast DDS; empty: not known."""
    process = (os.getpid() & 0xFFFF).to_bytes(2, "little")
    for item in node.get_publishers_info_by_topic(_PARAMETER_EVENTS):
        identifier = _identifier(item)
        if item.node_name == node.get_name() and identifier[:2] == _FAST_DDS and identifier[4:6] == process:
            return identifier[2:4]
    return b""


def _place(item: TopicEndpointInfo, own_machine: bytes) -> str:
    """Machine of a publisher, in words; empty if its DDS or ours does not report it."""
    identifier = _identifier(item)
    if not own_machine or identifier[:2] != _FAST_DDS:
        return ""
    if identifier[2:4] != own_machine:
        return " on another machine"
    return " on this machine"
