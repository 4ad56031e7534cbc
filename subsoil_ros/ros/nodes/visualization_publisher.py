"""The machine for RViz, Foxglove and their like: its description and its tools once, /tf as it moves."""

from rclpy.node import Node

from ...loading.loader import ResolvedScene
from ...messages import MechanismState, ToolMotions
from ...recording.description import latched_messages
from ...recording.standard import transforms
from ...recording.topics import LATCHED, TRANSFORMS
from ...recording.types import serialize
from ..transport.convert import rclpy_class
from ..transport.qos import LATCHED_QOS, VISUALIZATION_QOS


class VisualizationPublisher:
    """Publishes for whoever moves the tools; the bytes are those of the bag. Nothing in a run waits for it.

    /tf is published where tf2_msgs is installed, the other topics always. /robot_description stands in the
    node's namespace.
    """

    def __init__(self, node: Node, resolved: ResolvedScene) -> None:
        self._scene = resolved.scene
        self._latched = []  # publishers: kept, or who comes later hears nothing
        for topic, message in latched_messages(resolved).items():
            publisher = node.create_publisher(rclpy_class(LATCHED[topic]), topic.lstrip("/"), LATCHED_QOS)
            publisher.publish(serialize(message))
            self._latched.append(publisher)
        try:
            kind = rclpy_class("tf2_msgs/msg/TFMessage")
        except ImportError:
            self._transforms = None
        else:
            self._transforms = node.create_publisher(kind, TRANSFORMS, VISUALIZATION_QOS)

    def move(self, state: MechanismState | None, motions: ToolMotions | None, time_ns: int) -> None:
        """Publishes where the bodies are, or, of a scene without mechanism, the tools."""
        if self._transforms is not None:
            message = transforms(self._scene, state, motions, time_ns)
            self._transforms.publish(serialize(message))
