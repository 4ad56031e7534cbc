"""The services and the action of simulation_interfaces, in whichever package's types they are served."""

import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from subsoil_ros.coupling.exit_status import ExitStatus
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.ros.nodes.run_control import Result, RunState
from subsoil_ros.ros.nodes.run_services import FEATURES, dialect
from tests.system.test_nodes import (
    LIMIT_S,
    TICKS,
    GatedSoil,
    SpringSoil,
    _own_domain,  # noqa: F401 (a fixture)
    contents,
    listener,  # noqa: F401 (a fixture)
    resolved,  # noqa: F401 (a fixture)
    run_without_ros,
)
from tests.system.test_pause import start

STANDARD = dialect().standard


class Client:
    """A client that steers simulators."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self.steps = ActionClient(node, dialect().action(), "/simulate_steps")
        self.feedback: list[tuple[int, int]] = []

    def call(self, kind: str, name: str, **request: Any) -> Any:
        """The answer of a service."""
        service = dialect().service(kind)
        client = self._node.create_client(service, f"/{name}")
        assert client.wait_for_service(LIMIT_S)
        return self.wait(client.call_async(service.Request(**request)))

    def wait(self, future: Any) -> Any:
        """What a future comes to."""
        self._executor.spin_until_future_complete(future, LIMIT_S)
        assert future.done()
        return future.result()

    def set_state(self, state: int) -> tuple[int, str]:
        """Asks for a state."""
        if STANDARD:
            from simulation_interfaces.msg import SimulationState

            wanted: Any = SimulationState(state=state)
        else:
            wanted = state
        return result_of(self.call("SetSimulationState", "set_simulation_state", state=wanted))

    def state(self) -> int:
        """The state of the run."""
        answer = self.call("GetSimulationState", "get_simulation_state")
        assert result_of(answer)[0] == Result.OK
        return answer.state.state if STANDARD else answer.state

    def begin_steps(self, steps: int) -> Any:
        """An accepted goal."""
        assert self.steps.wait_for_server(LIMIT_S)
        goal = dialect().action().Goal(steps=steps)
        return self.wait(self.steps.send_goal_async(goal, feedback_callback=self._hear))

    def _hear(self, message: Any) -> None:
        self.feedback.append((message.feedback.completed_steps, message.feedback.remaining_steps))

    def close(self) -> None:
        """Gives the node back."""
        self.steps.destroy()
        self._executor.shutdown()


def result_of(answer: Any) -> tuple[int, str]:
    """Code and words of an answer."""
    found = answer.result if STANDARD else answer
    return found.result, found.error_message


@pytest.fixture
def client(listener: Node) -> Iterator[Client]:  # noqa: F811
    """One in the domain of the test."""
    client = Client(listener)
    yield client
    client.close()


def test_a_run_that_is_steered_gives_the_same_bits(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    client: Client,
) -> None:
    """Features, states, steps by service and action, pause and play; the bag of a run left alone."""
    thread, statuses = start(resolved, tmp_path / "steered")
    features = client.call("GetSimulatorFeatures", "get_simulator_features")
    if STANDARD:
        kind = type(features.features)
        assert list(features.features.features) == [getattr(kind, name) for name in FEATURES]
    else:
        assert tuple(features.features) == FEATURES
    assert result_of(client.call("StepSimulation", "step_simulation", steps=2)) == (Result.OK, "")
    assert client.state() == RunState.PAUSED
    code, words = result_of(client.call("StepSimulation", "step_simulation", steps=0))
    assert (code, words) == (Result.OPERATION_FAILED, "step: 0 steps asked for; give 1 or more")
    assert client.set_state(RunState.PAUSED) == (Result.ALREADY_IN_TARGET_STATE, "")
    code, words = client.set_state(RunState.STOPPED)
    assert code == Result.FEATURE_UNSUPPORTED
    assert "cannot be reset" in words
    code, words = result_of(client.call("ResetSimulation", "reset_simulation"))
    assert code == Result.FEATURE_UNSUPPORTED
    assert "start another" in words
    assert client.set_state(9)[0] == Result.OPERATION_FAILED
    handle = client.begin_steps(5)
    answer = client.wait(handle.get_result_async())
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert result_of(answer.result) == (Result.OK, "")
    assert client.feedback[-1] == (5, 0)
    assert client.set_state(RunState.PLAYING) == (Result.OK, "")
    thread.join(LIMIT_S)
    assert statuses == [ExitStatus()]
    run_without_ros(resolved, tmp_path / "direct", SpringSoil())
    assert contents(tmp_path / "steered") == contents(tmp_path / "direct")


def test_steps_that_are_cancelled_stand_where_they_are(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    client: Client,
) -> None:
    """A goal of many ticks is cancelled while the soil computes: the run then stands, is no more, no less."""
    gate, at = threading.Event(), threading.Event()
    thread, statuses = start(resolved, tmp_path / "bag", partial(GatedSoil, gate, at))
    handle = client.begin_steps(TICKS)
    assert at.wait(LIMIT_S)
    assert client.wait(handle.cancel_goal_async()).goals_canceling
    time.sleep(0.3)  # longer than from one poll of the coupler to the next
    gate.set()
    answer = client.wait(handle.get_result_async())
    assert answer.status == GoalStatus.STATUS_CANCELED
    code, words = result_of(answer.result)
    stands = int(words.removeprefix("cancelled at the end of tick "))
    assert code == Result.OK
    assert 2 < stands <= 2 + resolved.scene.coupling.grant_window  # granted while tick 2 was done
    assert client.state() == RunState.PAUSED
    assert client.set_state(RunState.PLAYING)[0] == Result.OK
    thread.join(LIMIT_S)
    assert statuses == [ExitStatus()]


def test_steps_need_a_pause(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    client: Client,
) -> None:
    """While the run plays, steps are refused with INCORRECT_STATE, by service and by action."""
    gate, at = threading.Event(), threading.Event()
    thread, statuses = start(resolved, tmp_path / "bag", partial(GatedSoil, gate, at))
    assert client.set_state(RunState.PLAYING)[0] == Result.OK
    assert at.wait(LIMIT_S)
    assert client.state() == RunState.PLAYING
    assert client.set_state(RunState.PLAYING)[0] == Result.ALREADY_IN_TARGET_STATE
    code, words = result_of(client.call("StepSimulation", "step_simulation", steps=1))
    assert (code, words) == (Result.INCORRECT_STATE, "step: the run is not paused; pause it first")
    answer = client.wait(client.begin_steps(1).get_result_async())
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert result_of(answer.result)[0] == Result.INCORRECT_STATE
    gate.set()
    thread.join(LIMIT_S)
    assert statuses == [ExitStatus()]


def test_a_run_can_be_ended_by_service(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    client: Client,
) -> None:
    """QUITTING: answered, then the run ends as by Ctrl-C, exit 130, with a bag that closes at a tick."""
    thread, statuses = start(resolved, tmp_path / "bag")
    assert result_of(client.call("StepSimulation", "step_simulation", steps=4))[0] == Result.OK
    assert client.set_state(RunState.QUITTING) == (Result.OK, "")
    thread.join(LIMIT_S)
    assert statuses == [ExitStatus(130, "ended by set_simulation_state: QUITTING")]
    run_without_ros(resolved, tmp_path / "direct", SpringSoil())
    recorded = contents(tmp_path / "bag")
    assert recorded == contents(tmp_path / "direct")[: len(recorded)]
    assert recorded[-1][1] == 4 * resolved.timing.communication_step_ns
