"""Loop that waits for messages of one node and calls its callbacks, in the order of its subscriptions.

rclpy's executors spend more time on a message than the transport does: per exchange between four
processes the single-threaded one takes twice as long as this loop, which waits and takes as
rclpy.wait_for_message does. rclpy's EventsExecutor is as quick, but version 7.1.6 can hang in spin()
holding the GIL.
"""

import time
from collections.abc import Callable, Collection, Sequence

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.service import Service

BURST = 64
"""Most messages or requests taken from one subscription or service before the next one is served."""


def serve(
    node: Node,
    poll: Callable[[], None],
    poll_s: float,
    ended: Callable[[], bool],
    rest_s: Callable[[], float] = lambda: 0.0,
) -> None:
    """Serve the subscriptions, all raw, and services of `node` in this thread; it must be in no executor.

    A service's callback receives the request and the header for its response, which it may send later.

    Args:
        poll: called every `poll_s`, also while messages come.
        ended: called after every message and every poll; the loop ends when it returns True.
        rest_s: returns the pause after a wake-up, in which messages are collected to be taken together.
            For nodes that no other node waits for: each wake-up takes a core from those that compute. After
            a request there is no pause.
    """
    served = [(item.handle, item.handle.pointer, item.msg_type, item.callback) for item in node.subscriptions]
    services = list(node.services)
    wait_set = _rclpy.WaitSet(len(served), 0, 0, 0, len(services), 0, node.context.handle)
    next_poll = time.monotonic()
    while not ended():
        left_s = next_poll - time.monotonic()
        if left_s <= 0.0:
            poll()
            next_poll = time.monotonic() + poll_s
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
        asked = bool(services) and _answer(services, wait_set.get_ready_entities("service"), ended)
        pause_s = rest_s()
        if pause_s > 0.0 and not asked:
            time.sleep(pause_s)


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


def _answer(services: Sequence[Service], ready: Collection[int], ended: Callable[[], bool]) -> bool:
    """Pass on the requests that have come; return whether there were any. None is taken once `ended`."""
    asked = False
    for service in services:
        if service.handle.pointer not in ready:
            continue
        for _ in range(BURST):
            if ended():
                return asked
            kind = service.srv_type.Request  # type: ignore[attr-defined]
            request, header = service.handle.service_take_request(kind)
            if header is None:
                break
            asked = True
            service.callback(request, header)
    return asked
