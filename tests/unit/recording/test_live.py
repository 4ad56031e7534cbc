"""The live view: newest and late-comers, slow clients, ports."""

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from subsoil_ros.errors import InputError
from subsoil_ros.messages import Grant
from subsoil_ros.recording.bag_folder import TopicInfo
from subsoil_ros.recording.bag_writer import BagWriter
from subsoil_ros.recording.live_view import LiveView
from subsoil_ros.recording.types import schema_text
from tests.live_client import LiveClient, stalled
from tests.unit.recording.recording_samples import SCENE, TIMING

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")

KIND = "subsoil_msgs/msg/SoilState"
TOPIC = TopicInfo("/subsoil/soil_state", KIND, schema_text(KIND), "", [])
CLOUDS = TopicInfo("/subsoil/soil/points", "sensor_msgs/msg/PointCloud2", "uint8[] data", "", [])


def free_port() -> int:
    """A port without a server."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_until(condition: Callable[[], bool]) -> None:
    """Until it holds, for at most 20 s."""
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.fixture
def view() -> Iterator[LiveView]:
    """A live view with a series topic and clouds."""
    live = LiveView(free_port(), "test")
    live.add_topic(TOPIC, 100)
    live.add_topic(CLOUDS, 1)
    yield live
    live.close()


def test_a_client_gets_schema_messages_and_time(view: LiveView) -> None:
    """As the protocol has them: CDR, ros2msg, log times in simulated nanoseconds."""
    client = LiveClient(view.port)
    view.write(TOPIC.name, 0, bytes([0]))
    wait_until(lambda: bool(client.of(TOPIC.name)))  # its subscription has arrived
    for tick in range(1, 50):
        view.write(TOPIC.name, 1000 * tick, bytes([tick]))
    view.close()
    client.join(20.0)
    assert "time" in client.server["capabilities"]
    channel = next(item for item in client.channels.values() if item["topic"] == TOPIC.name)
    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
    assert (channel["schemaName"], channel["schema"]) == (KIND, TOPIC.schema)
    times = [time_ns for time_ns, _ in client.of(TOPIC.name)]
    assert times == sorted(times)
    assert client.of(TOPIC.name)[-1] == (49_000, bytes([49]))
    assert client.times_ns[-1] == 49_000


def test_a_late_comer_sees_the_newest_of_every_topic(view: LiveView) -> None:
    """A cloud may be minutes old, and the next one far away."""
    view.write(CLOUDS.name, 1, b"old")
    view.write(CLOUDS.name, 2, b"cloud")
    view.write(TOPIC.name, 3, b"state")
    client = LiveClient(view.port)
    wait_until(lambda: bool(client.of(CLOUDS.name) and client.of(TOPIC.name)))
    assert client.of(CLOUDS.name)[-1] == (2, b"cloud")
    assert client.of(TOPIC.name)[-1] == (3, b"state")


def test_a_client_that_does_not_read_holds_nobody(view: LiveView) -> None:
    """Writing goes on, thousands of messages beyond every buffer on the way; another client sees the last."""
    with stalled(view.port):
        client = LiveClient(view.port)
        wait_until(lambda: len(client.channels) == 2)
        cloud = bytes(50_000)
        for number in range(5000):
            view.write(CLOUDS.name, number, cloud)
            view.write(TOPIC.name, number, b"state")
        wait_until(lambda: (4999, b"state") in client.of(TOPIC.name))
        wait_until(lambda: (4999, cloud) in client.of(CLOUDS.name))


def test_a_port_that_is_taken_is_an_error_and_leaves_no_bag(view: LiveView, tmp_path: Path) -> None:
    """One message, with what to do."""
    with pytest.raises(InputError, match=f"port {view.port} cannot be used"):
        BagWriter(tmp_path / "bag", SCENE, TIMING, live_port=view.port)
    assert not (tmp_path / "bag").exists()


def test_the_view_ends_with_the_bag(tmp_path: Path) -> None:
    """And what was last written has been seen."""
    writer = BagWriter(tmp_path / "bag", SCENE, TIMING, live_port=(port := free_port()))
    client = LiveClient(port)
    for tick in range(2):  # the second one ends tick 0
        writer.write(Grant("run", tick))
    wait_until(lambda: bool(client.of("/subsoil/grant")))  # its subscription has arrived
    for tick in range(2, 20):
        writer.write(Grant("run", tick))
    writer.close()
    client.join(20.0)
    assert not client.is_alive()
    assert client.of("/subsoil/grant")[-1][0] == 20 * TIMING.communication_step_ns
