"""Live view of a run: the messages of the bag go to Foxglove too, over foxglove-sdk's WebSocket server.

The recorder puts messages into queues of bounded size, which never blocks. A thread of this module passes
them to the server many times a second; the server drops messages that a slow client does not take. So a
viewer can neither delay nor change a run; one that is too slow misses messages.
"""

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

from ..errors import InputError
from ..extras import require
from .bag_folder import TopicInfo

HOST = "127.0.0.1"
"""Only this machine can connect, because there is no password; from others use a tunnel."""

PERIOD_S = 0.02
"""Time between two deliveries: 50 a second, about the rate at which screens are redrawn."""

SERIES_DEPTH = 200
"""Messages of a series topic that one delivery takes: 10,000 a second, more than runs write."""

_LAST_DELIVERY_S = 5.0
"""Time for the delivery in progress when the view is closed."""

_LAST_SENDING_S = 0.3
"""Time for the server to send the last messages; it drops the rest when it stops. Every run with a live view
ends later by this time."""

_Message = tuple[int, bytes]  # simulated time [ns], CDR


@dataclass
class _Topic:
    channel: Any  # foxglove.Channel
    box: deque[_Message]
    newest: _Message | None = None


class LiveView:
    """A server on this machine that shows topics while they are written. Close it with the run."""

    def __init__(self, port: int, name: str) -> None:
        """Serve on `port`.

        Raises:
            InputError: foxglove-sdk is not installed, or the port is taken.
        """
        require("a live view", "foxglove")
        import foxglove
        from foxglove.websocket import Capability, ServerListener

        asked = self._asked = set[str]()

        class _Newcomers(ServerListener):
            """Records topics to which a viewer subscribes; the next delivery has their newest message."""

            def on_subscribe(self, client: Any, channel: Any) -> None:
                asked.add(channel.topic)

        self._foxglove = foxglove
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=name,
                host=HOST,
                port=port,
                capabilities=[Capability.Time],
                server_listener=_Newcomers(),
                context=self._context,
            )
        except (OSError, RuntimeError) as error:
            raise InputError(
                f"live view: port {port} cannot be used ({error}); name another, or 0 for any that is free"
            ) from error
        self._topics: dict[str, _Topic] = {}
        self._time_ns = -1
        self._told_ns = -1
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._deliver_until_over, name="live view", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """Port of the server."""
        return int(self._server.port)

    def add_topic(self, info: TopicInfo, depth: int) -> None:
        """Offer a topic, before its first message.

        depth: messages that wait for a delivery; when there are more, the oldest are dropped.
        """
        schema = self._foxglove.Schema(
            name=info.message_type, encoding="ros2msg", data=info.schema.encode("utf-8")
        )
        channel = self._foxglove.Channel(
            info.name, schema=schema, message_encoding="cdr", context=self._context
        )
        self._topics[info.name] = _Topic(channel, deque(maxlen=depth))

    def write(self, topic: str, time_ns: int, data: bytes) -> None:
        """Queue a message and return at once; one of a topic that is not offered is ignored."""
        known = self._topics.get(topic)
        if known is not None:  # a view never fails a run
            known.box.append((time_ns, data))
            self._time_ns = time_ns

    def close(self) -> None:
        """Deliver the queued messages and stop the server. Idempotent."""
        if self._over.is_set():
            return
        self._over.set()
        self._thread.join(_LAST_DELIVERY_S)
        time.sleep(_LAST_SENDING_S)
        self._server.stop()

    def _deliver_until_over(self) -> None:
        while not self._over.wait(PERIOD_S):
            self._deliver()
        self._deliver()

    def _deliver(self) -> None:
        waiting: list[tuple[int, bytes, _Topic]] = []
        for name, topic in list(self._topics.items()):
            if name in self._asked:
                self._asked.discard(name)
                if topic.newest is not None:
                    waiting.append((*topic.newest, topic))
            while topic.box:
                topic.newest = topic.box.popleft()
                waiting.append((*topic.newest, topic))
        waiting.sort(key=lambda item: item[0])  # stable: equal times stay in their order
        for time_ns, data, topic in waiting:
            topic.channel.log(data, log_time=time_ns)
        if self._time_ns > self._told_ns:
            self._told_ns = self._time_ns
            self._server.broadcast_time(self._told_ns)
