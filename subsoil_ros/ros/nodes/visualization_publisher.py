"""The machine for RViz, Foxglove and their like: its description and its tools once, /tf as it moves."""

from dataclasses import dataclass

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy

from ...loading.loader import ResolvedScene
from ...messages import MechanismState, ToolMotion
from ...recording.message_codec import standard_bytes
from ...recording.standard_messages import latched_messages, transforms
from ...recording.topics import LATCHED, TRANSFORMS
from ...recording.types import serialize
from ..transport.qos import LATCHED_QOS, VISUALIZATION_QOS, rclpy_class


@dataclass
class _Latched:
    """A message that is published once and kept, with the numbers of its listeners."""

    publisher: Publisher
    cdr: bytes
    listeners: int = 0
    volatile: int = 0


class VisualizationPublisher:
    """Publishes for visualization, beside the motion source, the bytes of the bag. No node waits for them.

    /tf is published where tf2_msgs is installed, the other topics always. /robot_description stands in the
    node's namespace.
    """

    def __init__(self, node: Node, resolved: ResolvedScene) -> None:
        self._node = node
        self._scene = resolved.scene
        self._latched: list[_Latched] = []
        for topic, message in latched_messages(resolved).items():
            publisher = node.create_publisher(rclpy_class(LATCHED[topic]), topic.lstrip("/"), LATCHED_QOS)
            self._latched.append(_Latched(publisher, serialize(message)))
            publisher.publish(self._latched[-1].cdr)
        try:
            kind = rclpy_class("tf2_msgs/msg/TFMessage")
        except ImportError:
            self._transforms = None
        else:
            self._transforms = node.create_publisher(kind, TRANSFORMS, VISUALIZATION_QOS)

    def poll(self) -> None:
        """Publishes the description and the tools again for new listeners whose durability is volatile.

        Displays of RViz have that by default, and do not receive messages published before they subscribe.
        """
        for latched in self._latched:
            count = latched.publisher.get_subscription_count()
            if count == latched.listeners:
                continue
            latched.listeners = count
            found = self._node.get_subscriptions_info_by_topic(latched.publisher.topic_name)
            volatile = sum(item.qos_profile.durability == DurabilityPolicy.VOLATILE for item in found)
            if volatile > latched.volatile:
                latched.publisher.publish(latched.cdr)
            latched.volatile = volatile

    def move(self, state: MechanismState | None, motions: tuple[ToolMotion, ...], time_ns: int) -> None:
        """Publish the poses of the bodies or, in a scene without mechanism, of the tools."""
        if self._transforms is not None:
            places = transforms(self._scene, state, motions, time_ns)
            self._transforms.publish(standard_bytes(TRANSFORMS, places))
