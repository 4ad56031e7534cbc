"""A client of Foxglove's WebSocket protocol, for tests: subscribes to everything and keeps what comes."""

import json
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

PROTOCOL = Subprotocol("foxglove.sdk.v1")
LIMIT_S = 300.0
"""No client waits longer; kernels may have to be compiled."""

_MESSAGE_DATA, _TIME = 1, 2  # binary opcodes of the server
_DATA_HEAD = struct.Struct("<BIQ")  # opcode, subscription, log time


@contextmanager
def connected(port: int) -> Iterator[ClientConnection]:
    """A connection, as soon as there is a server."""
    deadline = time.monotonic() + LIMIT_S
    with ExitStack() as stack:
        while True:
            try:
                address = f"ws://127.0.0.1:{port}"
                opening = connect(address, subprotocols=[PROTOCOL], max_size=None, close_timeout=1.0)
                connection = stack.enter_context(opening)
                break
            except OSError:
                assert time.monotonic() < deadline, f"no server on port {port}"
                time.sleep(0.02)
        yield connection


class LiveClient(threading.Thread):
    """Follows a live view from the moment it serves until it closes."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self._port = port
        self.server: dict[str, Any] = {}
        self.channels: dict[int, dict[str, Any]] = {}
        self.messages: list[tuple[str, int, bytes]] = []  # topic, log time, data
        self.times_ns: list[int] = []
        self.start()

    def run(self) -> None:
        """Reads until the server closes."""
        with connected(self._port) as connection:
            assert connection.subprotocol == PROTOCOL
            try:
                for item in connection:
                    if isinstance(item, str):
                        self._take_text(connection, json.loads(item))
                    else:
                        self._take_bytes(item)
            except ConnectionClosed:
                return

    def of(self, topic: str) -> list[tuple[int, bytes]]:
        """Messages of a topic that have come."""
        return [(time_ns, data) for name, time_ns, data in list(self.messages) if name == topic]

    def _take_text(self, connection: ClientConnection, message: dict[str, Any]) -> None:
        if message["op"] == "serverInfo":
            self.server = message
        elif message["op"] == "advertise":
            self.channels.update({channel["id"]: channel for channel in message["channels"]})
            wishes = [{"id": channel["id"], "channelId": channel["id"]} for channel in message["channels"]]
            connection.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))

    def _take_bytes(self, message: bytes) -> None:
        if message[0] == _MESSAGE_DATA:
            _, number, time_ns = _DATA_HEAD.unpack_from(message)
            self.messages.append((self.channels[number]["topic"], time_ns, message[_DATA_HEAD.size :]))
        elif message[0] == _TIME:
            self.times_ns.append(struct.unpack_from("<Q", message, 1)[0])


@contextmanager
def stalled(port: int) -> Iterator[None]:
    """A client that asks for everything there is and then takes nothing more."""
    with connected(port) as connection:
        while (message := json.loads(connection.recv(LIMIT_S)))["op"] != "advertise":
            pass
        wishes = [{"id": channel["id"], "channelId": channel["id"]} for channel in message["channels"]]
        connection.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))
        yield
