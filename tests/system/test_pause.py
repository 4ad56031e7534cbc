"""Pause, resume and step through the coupler's services, around small engines of known arithmetic."""

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger
from subsoil_msgs.msg import CouplingReport
from subsoil_msgs.srv import Step

from subsoil_ros.coupling.exit_status import ExitStatus
from subsoil_ros.coupling.protocol import COUPLER
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.ros.nodes import coupler_node
from subsoil_ros.ros.nodes.composed import run_composed
from tests.system.conftest import messages
from tests.system.test_nodes import (
    LIMIT_S,
    TICKS,
    SpringMover,
    SpringSoil,
    _own_domain,  # noqa: F401 (a fixture)
    builds,
    contents,
    listener,  # noqa: F401 (a fixture)
    resolved,  # noqa: F401 (a fixture)
    run_nodes,
    run_without_ros,
)


class User:
    """Calls the coupler's services."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._clients = {
            name: node.create_client(kind, f"{COUPLER}/{name}")
            for name, kind in (("pause", Trigger), ("resume", Trigger), ("step", Step))
        }

    def call(self, name: str, **request: Any) -> Any:
        """The answer of a service."""
        client = self._clients[name]
        assert client.wait_for_service(LIMIT_S)
        future = client.call_async(client.srv_type.Request(**request))
        self._executor.spin_until_future_complete(future, LIMIT_S)
        assert future.done()
        return future.result()

    def close(self) -> None:
        """Gives the node back."""
        self._executor.shutdown()


@pytest.fixture
def user(listener: Node) -> Iterator[User]:  # noqa: F811
    """A client of the coupler's services."""
    user = User(listener)
    yield user
    user.close()


def start(
    resolved: ResolvedScene,  # noqa: F811
    bag: Path,
    soil: Callable[[], SpringSoil] = SpringSoil,
) -> tuple[threading.Thread, list[ExitStatus]]:
    """A composed run that is paused before its first tick, in a thread of its own."""
    (tool,) = resolved.scene.tools
    nodes = builds(resolved, bag, partial(SpringMover, tool), soil)
    statuses: list[ExitStatus] = []
    thread = threading.Thread(
        target=lambda: statuses.append(run_composed(RunSettings(resolved, "test", paused=True), nodes))
    )
    thread.start()
    return thread, statuses


def test_a_paused_and_stepped_run_gives_the_same_bits(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    user: User,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stands longer than a tick may take, steps, pauses and resumes: the bag of an undisturbed run."""
    monkeypatch.setattr(coupler_node, "DEADLINE_S", 3.0)
    monkeypatch.setattr(coupler_node, "STARTUP_S", 20.0)
    thread, statuses = start(resolved, tmp_path / "paused")
    one = user.call("step", steps=1)
    assert (one.success, one.tick) == (True, 0)
    assert user.call("step", steps=5).tick == 5
    time.sleep(3.5)  # longer than the deadline
    assert thread.is_alive()
    assert not user.call("step", steps=0).success
    assert user.call("resume").success
    assert user.call("pause").success
    thread.join(0.1)
    if thread.is_alive():
        assert user.call("resume").success
    thread.join(LIMIT_S)
    assert statuses == [ExitStatus()]
    assert run_nodes(resolved, tmp_path / "undisturbed", SpringSoil) == ExitStatus()
    assert without_wall_time(tmp_path / "paused") == without_wall_time(tmp_path / "undisturbed")
    run_without_ros(resolved, tmp_path / "direct", SpringSoil())
    assert contents(tmp_path / "paused") == contents(tmp_path / "direct")


def without_wall_time(bag: Path) -> list[tuple[str, int, bytes]]:
    """Every message as it stands in the bag, but for the one field that differs from run to run."""
    return [
        (topic, time_ns, data[:-8] if topic.endswith("coupling_report") else data)
        for topic, time_ns, data in messages(bag)
    ]


def test_wall_time_leaves_pauses_out(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    user: User,
) -> None:
    """A run stands a second before its first tick and a second within: its wall time has neither."""
    stood_s, begin = 1.0, time.monotonic()
    thread, statuses = start(resolved, tmp_path / "bag")
    for _ in range(2):
        assert user.call("step", steps=8).success
        time.sleep(stood_s)
    assert user.call("resume").success
    thread.join(LIMIT_S)
    whole_s = time.monotonic() - begin
    assert statuses == [ExitStatus()]
    reports = [
        deserialize_message(data, CouplingReport)
        for topic, _, data in messages(tmp_path / "bag")
        if topic.endswith("coupling_report")
    ]
    times_s = [report.wall_time_s for report in reports]
    assert times_s == sorted(times_s)
    assert 0.0 < times_s[-1] < whole_s - 2.0 * stood_s


def test_who_waits_for_steps_hears_of_a_fault(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    user: User,
) -> None:
    """An engine fails within the steps asked for: the answer says so, and the run ends by name."""
    thread, statuses = start(resolved, tmp_path / "bag", lambda: SpringSoil(fail_tick=7))
    answer = user.call("step", steps=TICKS)
    assert not answer.success
    assert answer.message == "the run has ended: soil: tick 7: overlap too deep"
    assert answer.tick == 6
    thread.join(LIMIT_S)
    assert statuses == [ExitStatus(3, "soil: tick 7: overlap too deep")]
