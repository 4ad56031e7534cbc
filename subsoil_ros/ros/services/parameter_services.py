"""The parameter services of a node, served by the node of its process.

While an engine computes, a node answers no request; the node of its process, spun in another thread, does.
`ros2 param` calls the services of every node that it finds, so they must exist under both names.
"""

from typing import Any

from rclpy.node import Node
from rclpy.parameter_service import ParameterService


class ParameterServices:
    """Serves list, get, describe and the others of rclpy under another node's name.

    Args:
        node: has the parameters, and is spun.
        name: name of the other node, in the same namespace.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._named = _Named(node, name)  # kept: the service holds only a weak reference
        self._service = ParameterService(self._named)


class _Named:
    """A node under another name."""

    def __init__(self, node: Node, name: str) -> None:
        self._node, self._name = node, name

    def get_name(self) -> str:
        """The other name."""
        return self._name

    def __getattr__(self, key: str) -> Any:
        return getattr(self._node, key)
