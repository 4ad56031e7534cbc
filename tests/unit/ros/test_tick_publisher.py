"""What a TickPublisher publishes and when; how many ticks are granted ahead. Clock and DDS are stand-ins."""

import pytest

from subsoil_ros.coupling.time_limits import BATCH_S, GRANTED_S
from subsoil_ros.recording.message_batches import unpacked
from subsoil_ros.ros.nodes import wall_times
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


def test_ticks_granted_ahead_follow_their_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """8 before one is known, then those that take GRANTED_S; a slower last batch counts at once."""
    now = 0.0
    monkeypatch.setattr(wall_times.time, "monotonic", lambda: now)
    times = wall_times.TickTimes()
    assert (times.median_s, times.ahead) == (0.0, 8)
    now = 20.0
    times.restart(99)  # the start of a resumed run
    for tick in (109, 119, 129):
        now += 0.1
        times.note(tick)
    times.note(129)
    assert times.median_s == pytest.approx(0.01)
    assert times.ahead == pytest.approx(GRANTED_S / 0.01, abs=1)
    now += 10.0
    times.note(130)
    assert (times.median_s, times.ahead) == (pytest.approx(0.01), 1)
