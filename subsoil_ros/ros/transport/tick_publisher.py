"""Publishes the messages of every tick: at once to listeners, and in batches to nodes no engine waits for."""

import threading
import time

from rclpy.publisher import Publisher

from ...coupling.time_limits import BATCH_S
from ...recording.message_batches import packed


class TickPublisher:
    """Publishes a message at once if it has listeners, and together with others as a batch.

    A batch goes out when it has `most` messages, with a message that comes BATCH_S after its first,
    and by `flush`, from any thread.
    """

    def __init__(self, singles: Publisher, batches: Publisher, most: int) -> None:
        self._singles, self._batches, self._most = singles, batches, most
        self._kept: list[bytes] = []
        self._due_s = 0.0
        self._lock = threading.RLock()

    def publish(self, cdr: bytes) -> None:
        """Publish a serialized message."""
        if self._singles.get_subscription_count():
            self._singles.publish(cdr)
        with self._lock:
            if not self._kept:
                self._due_s = time.monotonic() + BATCH_S
            self._kept.append(cdr)
            if len(self._kept) >= self._most or time.monotonic() >= self._due_s:
                self.flush()

    def flush(self) -> None:
        """Publish the messages kept."""
        with self._lock:
            if self._kept:
                self._batches.publish(packed(self._kept))
                self._kept.clear()

    def drop(self) -> None:
        """Publish nothing that is kept."""
        with self._lock:
            self._kept.clear()
