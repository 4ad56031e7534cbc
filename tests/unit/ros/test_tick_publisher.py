"""What a TickPublisher publishes, and when; publishers are stood in for."""

import pytest

from subsoil_ros.coupling.time_limits import BATCH_S
from subsoil_ros.recording.message_batches import unpacked
from subsoil_ros.ros.transport import tick_publisher


class Sent:
    """Keeps what is published."""

    def __init__(self, listeners: int = 1) -> None:
        self.messages: list[bytes] = []
        self.listeners = listeners

    def publish(self, message: bytes) -> None:
        self.messages.append(message)

    def get_subscription_count(self) -> int:
        return self.listeners


def test_singles_at_once_and_batches_when_full(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also when the first of a batch has waited, by a flush; singles only for listeners; nothing twice."""
    now = 0.0
    monkeypatch.setattr(tick_publisher.time, "monotonic", lambda: now)
    singles, batches = Sent(), Sent()
    publisher = tick_publisher.TickPublisher(singles, batches, 3)
    for message in (b"0", b"1", b"2", b"3"):
        publisher.publish(message)
    assert singles.messages == [b"0", b"1", b"2", b"3"]
    assert [unpacked(batch) for batch in batches.messages] == [(b"0", b"1", b"2")]
    now += BATCH_S
    singles.listeners = 0
    publisher.publish(b"4")
    publisher.flush()
    publisher.publish(b"5")
    publisher.flush()
    publisher.publish(b"6")
    publisher.drop()
    publisher.flush()
    assert singles.messages[4:] == []
    assert [unpacked(batch) for batch in batches.messages[1:]] == [(b"3", b"4"), (b"5",)]
