"""`subsoil run --live` in every mode: a WebSocket client sees the run, and nothing of the run changes."""

import socket
from pathlib import Path

import pytest

from subsoil_ros.recording.types import schema_text
from tests.live_client import LiveClient, stalled
from tests.system.conftest import Run, messages
from tests.system.test_modes import without_wall_time

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")

DURATION_S = 0.02


def free_port() -> int:
    """A port without a server."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def without_live(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run without a viewer."""
    run = Run(tmp_path_factory.mktemp("alone") / "out", "direct", DURATION_S)
    status, _, err = run.finish()
    assert status == 0, err
    return run.out


@pytest.mark.full
@pytest.mark.parametrize("mode", ["direct", "composed", "nodes"])
def test_a_client_sees_the_run(mode: str, tmp_path: Path, without_live: Path) -> None:
    """Every topic with its schema, messages that are the bag's, the last state; and the bag is the same."""
    port = free_port()
    run = Run(tmp_path / "out", mode, DURATION_S, "--live", str(port))
    client = LiveClient(port)
    status, out, err = run.finish()
    assert status == 0, err
    client.join(30.0)
    assert f"ws://127.0.0.1:{port}" in out

    recorded = messages(run.out / "bag")
    assert {channel["topic"] for channel in client.channels.values()} == {topic for topic, *_ in recorded}
    for channel in client.channels.values():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        assert channel["schema"] == schema_text(channel["schemaName"])
    in_bag = set(recorded)
    assert client.messages
    assert all(item in in_bag for item in client.messages)
    last = {topic: (time_ns, data) for topic, time_ns, data in recorded}
    for topic, newest in last.items():
        assert client.of(topic)[-1] == newest, topic
    assert client.times_ns == sorted(client.times_ns)
    assert without_wall_time(run.out) == without_wall_time(without_live)
    assert (run.out / "series.csv").read_bytes() == (without_live / "series.csv").read_bytes()


@pytest.mark.full
def test_a_client_that_never_reads_changes_nothing(tmp_path: Path, without_live: Path) -> None:
    """It asks for everything and takes nothing; the run ends as ever, with the same bag."""
    port = free_port()
    run = Run(tmp_path / "out", "direct", DURATION_S, "--live", str(port))
    with stalled(port):
        status, _, err = run.finish()
    assert status == 0, err
    assert without_wall_time(run.out) == without_wall_time(without_live)


def test_a_taken_port_is_bad_input(tmp_path: Path) -> None:
    """Exit 2, one message, no folder."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        run = Run(tmp_path / "out", "direct", DURATION_S, "--live", str(port))
        status, _, err = run.finish()
    assert status == 2
    assert f"live view: port {port} cannot be used" in err
    assert not run.out.exists()
