"""What is private in rclpy, all of it: each use has its reason here, and a change of rclpy is met here.

`serve` waits and takes messages as rclpy.wait_for_message does. rclpy's executors spend more time on a
message than the transport does: per exchange between four processes the single-threaded one takes twice as
long as this loop. rclpy's EventsExecutor is as quick, but version 7.1.6 can hang in spin() holding the GIL.
"""

import time
from collections.abc import Callable, Collection, Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.service import Service

BAD_ARGUMENTS = (_rclpy.RCLInvalidROSArgsError, _rclpy.UnknownROSArgsError)
"""Errors of rclpy.init about the arguments after --ros-args, which rclpy.exceptions does not name."""

Logger = RcutilsLogger
"""The class that get_logger returns, which no public module names."""

BURST = 64
"""Most messages or requests taken from one subscription or service before the next one is served."""


def serve(
    node: Node,
    poll: Callable[[], None],
    poll_s: float,
    ended: Callable[[], bool],
) -> None:
    """Serve the subscriptions, all raw, and services of `node` in this thread; it must be in no executor.

    A service's callback receives the request and the header for its response, which it may send later.

    Args:
        poll: called every `poll_s`, also while messages come.
        ended: called after every message and every poll; the loop ends when it returns True.
    """
    services = list(node.services)
    served, wait_set = _served(node, len(services))
    next_poll = time.monotonic()
    while not ended():
        left_s = next_poll - time.monotonic()
        if left_s <= 0.0:
            poll()
            next_poll = time.monotonic() + poll_s
            if len(served) != len(list(node.subscriptions)):  # the poll may have subscribed
                served, wait_set = _served(node, len(services))
            continue
        wait_set.clear_entities()
        for handle, *_ in served:
            wait_set.add_subscription(handle)
        for service in services:
            wait_set.add_service(service.handle)
        wait_set.wait(int(left_s * 1e9))
        ready = wait_set.get_ready_entities("subscription")
        for handle, pointer, kind, callback in served:
            if pointer not in ready:
                continue
            for _ in range(BURST):
                taken = handle.take_message(kind, True)
                if taken is None or ended():
                    break
                callback(*taken)
        if services:
            _answer(services, wait_set.get_ready_entities("service"), ended)


def _served(node: Node, services: int) -> tuple[list[tuple[Any, ...]], Any]:
    """What `serve` needs of each subscription, and a set to wait for them and for some services."""
    served = [(item.handle, item.handle.pointer, item.msg_type, item.callback) for item in node.subscriptions]
    return served, _rclpy.WaitSet(len(served), 0, 0, 0, services, 0, node.context.handle)


def serve_requests(node: Node, poll: Callable[[], None], poll_s: float, over: Callable[[], bool]) -> None:
    """Serve only the services of `node`, until `over`, with all requests that have come by then.

    Args:
        poll: called every `poll_s`.
    """
    services = list(node.services)
    wait_set = _rclpy.WaitSet(0, 0, 0, 0, len(services), 0, node.context.handle)
    last = not services
    while not last:
        last = over()
        poll()
        wait_set.clear_entities()
        for service in services:
            wait_set.add_service(service.handle)
        wait_set.wait(0 if last else int(poll_s * 1e9))
        _answer(services, wait_set.get_ready_entities("service"), lambda: False)


def new_response(service: Service) -> Any:
    """An empty response of a service, whose annotation does not say that it has one."""
    kind: Any = service.srv_type
    return kind.Response()


def given_parameters(node: Node) -> Collection[str]:
    """Names of the parameters that the node was started with: Node has no method for those not declared."""
    with node.handle:
        return set(node.handle.get_parameters(Parameter))


def _answer(services: Sequence[Service], ready: Collection[int], ended: Callable[[], bool]) -> None:
    """Pass on the requests that have come; none is taken once `ended`."""
    for service in services:
        if service.handle.pointer not in ready:
            continue
        for _ in range(BURST):
            if ended():
                return
            kind: Any = service.srv_type  # its annotation does not say that it has a Request
            request, header = service.handle.service_take_request(kind.Request)
            if header is None:
                break
            service.callback(request, header)


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
