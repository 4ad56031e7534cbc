"""Nodes started one by one, as `ros2 run` does it, with engines that compute nothing; no supervisor."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger
from subsoil_msgs.srv import Step

from benchmarks.lockstep import IDLE, write_scene
from subsoil_ros.coupling.protocol import COUPLER, MECHANISM, RECORDER, SOIL
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.ros.nodes.run_services import dialect
from subsoil_ros.ros.process.supervisor import node_program
from subsoil_ros.ros.transport.ros_domain import run_domain
from tests.system.conftest import SCENE, lockstep_ticks

LIMIT_S = 300.0
NODES = (MECHANISM, SOIL, RECORDER, COUPLER)
PROGRAMS: dict[str, tuple[str, ...]] = {
    **IDLE,
    RECORDER: node_program(RECORDER),
    COUPLER: node_program(COUPLER),
}
OTHER_VERSION = (
    "-c",
    "import sys, subsoil_ros._version as of; of.__version__ = '0.0';"
    "sys.argv = ['idle', 'soil', *sys.argv[1:]];"
    "from benchmarks.idle import main; raise SystemExit(main())",
)


class NodeSet:
    """The four nodes of a run."""

    def __init__(self, folder: Path, ticks: int) -> None:
        self.folder = folder
        self.scene = write_scene(folder, ticks)
        self.processes: dict[str, subprocess.Popen[str]] = {}

    def start(self, name: str, program: tuple[str, ...], scene: Path | None = None) -> None:
        """Starts a node; its words can be read from `words`."""
        parameters = {"scene": scene or self.scene, "run_id": "'hand'", "bag": self.folder / "bag"}
        options = [item for key, value in parameters.items() for item in ("-p", f"{key}:={value}")]
        with (self.folder / f"{name}.log").open("w") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, *program, "--ros-args", *options],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, text=True,
            )  # fmt: skip

    def wait_until_recording(self) -> None:
        """Until a chunk of the bag is on the disk."""
        deadline = time.monotonic() + LIMIT_S
        while sum(path.stat().st_size for path in self.folder.glob("bag/*.mcap")) < 70_000:
            assert time.monotonic() < deadline, self.words()
            time.sleep(0.02)

    def wait_for_words(self, name: str, words: str) -> None:
        """Until they stand in the log of a node."""
        deadline = time.monotonic() + LIMIT_S
        log = self.folder / f"{name}.log"
        while words not in log.read_text():
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.02)

    def wait(self) -> dict[str, int]:
        """Exit status of every node."""
        try:
            return {name: process.wait(LIMIT_S) for name, process in self.processes.items()}
        except subprocess.TimeoutExpired:
            still = [name for name, process in self.processes.items() if process.poll() is None]
            raise AssertionError(f"still running: {still}; {self.words()}") from None

    def words(self) -> dict[str, str]:
        """What every node said last."""
        logs = {name: (self.folder / f"{name}.log").read_text().strip() for name in self.processes}
        return {name: text.splitlines()[-1] if text else "" for name, text in logs.items()}

    def ticks(self) -> dict[str, list[int]]:
        """Ticks in the bag by lockstep topic."""
        return lockstep_ticks(self.folder / "bag", load_scene(self.scene).timing.communication_step_ns)


@pytest.fixture
def node_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int], NodeSet]]:
    """Makes the set, in a domain of its own; ends whatever is left."""
    made: list[NodeSet] = []

    def make(ticks: int) -> NodeSet:
        made.append(NodeSet(tmp_path, ticks))
        return made[-1]

    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with run_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        yield make
        for process in (process for nodes in made for process in nodes.processes.values()):
            process.kill()
            process.wait()


@pytest.mark.full
def test_a_node_of_another_scene_is_refused(node_set: Callable[[int], NodeSet], tmp_path: Path) -> None:
    """One node reads a scene with other content: named with both hashes, no node goes on, exit 3."""
    nodes = node_set(100_000)
    (tmp_path / "other").mkdir()
    for name in NODES:
        other = write_scene(tmp_path / "other", 200) if name == MECHANISM else None
        nodes.start(name, PROGRAMS[name], other)
    assert nodes.wait() == dict.fromkeys(NODES, 3), nodes.words()
    ours, theirs = load_scene(nodes.scene).scene_hash, load_scene(tmp_path / "other/scene.yaml").scene_hash
    expected = f"node_status: mechanism runs scene {theirs[:16]}, the coupler {ours[:16]}"
    assert f"[coupler]: {expected}" in nodes.words()[COUPLER]


@pytest.mark.full
def test_a_node_of_another_version_is_refused(node_set: Callable[[int], NodeSet]) -> None:
    """The same for another version of the package."""
    nodes = node_set(100_000)
    for name in NODES:
        nodes.start(name, OTHER_VERSION if name == SOIL else PROGRAMS[name])
    assert nodes.wait() == dict.fromkeys(NODES, 3), nodes.words()
    assert "node_status: soil is subsoil_ros 0.0, the coupler 0." in nodes.words()[COUPLER]


@pytest.mark.full
def test_a_node_that_starts_after_the_refusal_hears_of_it(node_set: Callable[[int], NodeSet]) -> None:
    """The coupler stays for a while to say so: no node waits for a coupler that has ended."""
    nodes = node_set(100_000)
    for name in (SOIL, RECORDER, COUPLER):
        nodes.start(name, OTHER_VERSION if name == SOIL else PROGRAMS[name])
    refused_by = time.monotonic() + LIMIT_S
    while "node_status" not in nodes.words()[COUPLER]:
        assert time.monotonic() < refused_by, nodes.words()
        time.sleep(0.05)
    assert nodes.processes[SOIL].wait(LIMIT_S) == 3
    nodes.start(MECHANISM, PROGRAMS[MECHANISM])
    assert nodes.wait() == dict.fromkeys((SOIL, RECORDER, COUPLER, MECHANISM), 3), nodes.words()
    assert "[mechanism]: coupler has ended: node_status: soil is" in nodes.words()[MECHANISM]


def test_nodes_say_what_they_wait_for(node_set: Callable[[int], NodeSet]) -> None:
    """A node alone names the others; with them it says that it is ready, and the coupler when it begins."""
    nodes = node_set(200)
    nodes.start(MECHANISM, PROGRAMS[MECHANISM])
    nodes.wait_for_words(MECHANISM, "[mechanism]: waits for node coupler, recorder, soil of run 'hand'")
    nodes.start(COUPLER, PROGRAMS[COUPLER])
    nodes.wait_for_words(COUPLER, "[coupler]: waits for ready from mechanism, recorder, soil of run 'hand'")
    nodes.wait_for_words(MECHANISM, "[mechanism]: waits for node recorder, soil of run 'hand'")
    for name in (SOIL, RECORDER):
        nodes.start(name, PROGRAMS[name])
    assert nodes.wait() == dict.fromkeys(NODES, 0), nodes.words()
    for name in (MECHANISM, SOIL, RECORDER):
        nodes.wait_for_words(name, f"[{name}]: ready for run 'hand'")
    nodes.wait_for_words(COUPLER, "[coupler]: run 'hand': running after tick -1")
    assert "[coupler]: run 'hand' has ended with tick 199" in nodes.words()[COUPLER]


def test_a_node_says_that_it_compiles(
    node_set: Callable[[int], NodeSet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the first kernel, where none is kept yet; the same words are on the screen of ros2 launch."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    nodes = node_set(200)
    nodes.start(SOIL, node_program(SOIL), SCENE.parent / "tine.yaml")
    nodes.wait_for_words(SOIL, f"compiling kernels, once, in 1 to 4 minutes: kept in {tmp_path / 'kernels'}")


@pytest.mark.full
def test_a_coupler_that_has_ended_refuses_requests(node_set: Callable[[int], NodeSet]) -> None:
    """While it stays to tell nodes that come late, a service call is answered at once with the reason."""
    nodes = node_set(100_000)
    for name in (SOIL, RECORDER, COUPLER):
        nodes.start(name, OTHER_VERSION if name == SOIL else PROGRAMS[name])
    nodes.wait_for_words(COUPLER, "[coupler]: node_status: soil is subsoil_ros 0.0")
    context = Context()
    rclpy.init(context=context)
    caller = Node("caller", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(caller)
    try:
        for name, kind in (("pause", Trigger), ("resume", Trigger), ("step", Step)):
            client = caller.create_client(kind, f"{COUPLER}/{name}")
            assert client.wait_for_service(LIMIT_S)
            begin = time.monotonic()
            future = client.call_async(kind.Request())
            executor.spin_until_future_complete(future, LIMIT_S)
            assert not future.result().success
            assert future.result().message.startswith("the run has ended: node_status: soil is")
            assert time.monotonic() - begin < 2.0
        kind = dialect().action()
        steps = ActionClient(caller, kind, "simulate_steps")
        assert steps.wait_for_server(LIMIT_S)
        goal = steps.send_goal_async(kind.Goal(steps=1))
        executor.spin_until_future_complete(goal, LIMIT_S)
        ended = goal.result().get_result_async()
        executor.spin_until_future_complete(ended, LIMIT_S)
        answer = ended.result().result.result if dialect().standard else ended.result().result
        assert answer.error_message.startswith("the run has ended: node_status: soil is")
        steps.destroy()
    finally:
        executor.shutdown()
        caller.destroy_node()
        rclpy.shutdown(context=context)


@pytest.mark.full
def test_the_terminal_of_the_coupler_closes(node_set: Callable[[int], NodeSet]) -> None:
    """SIGHUP of the coupler ends the run for all, with a finished bag and the cause in every node's words."""
    nodes = node_set(100_000)
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup the run would rightly go on
    for name in NODES:
        nodes.start(name, PROGRAMS[name])
    signal.signal(signal.SIGHUP, before)
    nodes.wait_until_recording()
    nodes.processes[COUPLER].send_signal(signal.SIGHUP)
    assert nodes.wait() == dict.fromkeys(NODES, 3), nodes.words()
    assert all("terminal was closed" in words for words in nodes.words().values()), nodes.words()
    ticks = nodes.ticks()
    count = len(ticks["grant"])
    assert count > 10
    assert ticks == {name: list(range(count)) for name in ticks}


@pytest.mark.full
def test_a_recorder_that_stalls_loses_nothing(node_set: Callable[[int], NodeSet]) -> None:
    """The recorder stands still again and again, as on a slow disk: the others wait, every tick is there."""
    nodes = node_set(3000)
    for name in NODES:
        nodes.start(name, PROGRAMS[name])
    nodes.wait_until_recording()
    recorder = nodes.processes[RECORDER]
    for _ in range(4):
        recorder.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        recorder.send_signal(signal.SIGCONT)
        time.sleep(0.1)
    assert nodes.wait() == dict.fromkeys(NODES, 0), nodes.words()
    assert nodes.ticks() == {name: list(range(3000)) for name in nodes.ticks()}
