"""The nodes in one process with small engines of known arithmetic."""

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from subsoil_msgs.msg import ToolMotions as ToolMotionsMessage

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.exit_status import ExitStatus
from subsoil_ros.coupling.observer import RunObserver
from subsoil_ros.coupling.protocol import BATCHES, COUPLER, MECHANISM, RECORDER, SOIL
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.errors import InputError, PhysicsError, RunError
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import (
    BodyState,
    MechanismState,
    SoilCloud,
    SoilState,
    ToolMotion,
    ToolWrench,
)
from subsoil_ros.recording.bag_writer import open_bag
from subsoil_ros.ros.nodes.composed import Build, run_composed
from subsoil_ros.ros.nodes.coupler_node import CouplerNode
from subsoil_ros.ros.nodes.mechanism_node import MechanismNode
from subsoil_ros.ros.nodes.recorder_node import RecorderNode
from subsoil_ros.ros.nodes.soil_node import SoilNode
from subsoil_ros.ros.process import heartbeat
from subsoil_ros.ros.transport.qos import LOCKSTEP_QOS
from subsoil_ros.ros.transport.ros_domain import run_domain
from subsoil_ros.ticks import INITIAL_TICK
from tests.system.conftest import SCENE, lockstep_ticks, messages

TICKS = 60
LIMIT_S = 60.0


class SpringMover:
    """One tool of 1 kg that the soil pushes; explicit steps of 1 ms."""

    def __init__(self, tool: str) -> None:
        self._tool = tool
        self._x = 0.0
        self._v = 0.5

    def initial_motions(self) -> tuple[ToolMotion, ...]:
        return (ToolMotion(self._tool, self._x, 0.0, 0.0, 0.0, self._v, 0.0, 0.0),)

    def advance(self, tick: int, wrenches: tuple[ToolWrench, ...]) -> tuple[ToolMotion, ...]:
        for wrench in wrenches:
            self._v += 1e-3 * wrench.force_x_newton
        self._x += 1e-3 * self._v
        return self.initial_motions()

    def initial_state(self, run_id: str, wrenches: tuple[ToolWrench, ...]) -> MechanismState:
        return self.state(run_id, INITIAL_TICK, 0)

    def state(self, run_id: str, tick: int, end_time_ns: int) -> MechanismState:
        body = BodyState(self._tool, self._x, *[0.0] * 8)
        return MechanismState(run_id, tick, end_time_ns, *[0.0] * 10, 0, bodies=(body,))


class SpringSoil:
    """Pushes back with 100 N/m; at `fail_tick` it gives up; its work is off by the factor `invented`."""

    def __init__(self, fail_tick: int = -1, invented: float = 1.0) -> None:
        self._fail_tick = fail_tick
        self._invented = invented
        self._x = 0.0

    def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        return self._answer(motions)

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        if tick == self._fail_tick:
            raise PhysicsError(f"tick {tick}: overlap too deep")
        return self._answer(motions)

    def ends_with(self, tick: int) -> None:
        pass

    def state(self, run_id: str, tick: int, end_time_ns: int) -> SoilState:
        return SoilState(run_id, tick, end_time_ns, 1, 0, 0, 0, 0, *[0.0] * 5)

    def cloud(self, tick: int, end_time_ns: int) -> SoilCloud:
        return SoilCloud(tick, end_time_ns, [[self._x, 0.0, 0.0]], [0.0])

    def _answer(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        (motion,) = motions
        work = -50.0 * (motion.x_m**2 - self._x**2) * self._invented
        self._x = motion.x_m
        return (ToolWrench(motion.tool, -100.0 * motion.x_m, 0.0, 0.0, 0.0, 0.0, 0.0, work, 1),)


CHANGES = [
    "coupling.communication_step_ns=48000", f"duration_s={TICKS * 48e-6}", "record.series_ticks=7",
    "record.cloud_hz=1000", "coupling.residual_grace_joule=0.005", "coupling.residual_bound=0.3",
]  # fmt: skip


@pytest.fixture
def resolved() -> ResolvedScene:
    """The quick scene for its names and rates; nothing of its physics is used."""
    return load_scene(SCENE, CHANGES)


@pytest.fixture(autouse=True)
def _own_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with run_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield


def builds(
    resolved: ResolvedScene,
    bag: Path,
    motion_source: Callable[[], SpringMover],
    soil: Callable[[], SpringSoil],
) -> dict[str, Build]:
    """All four nodes around the small engines."""
    return {
        MECHANISM: lambda run, heartbeat, context: MechanismNode(motion_source(), run, heartbeat, context),
        SOIL: lambda run, heartbeat, context: SoilNode(soil(), None, run, heartbeat, context),
        RECORDER: lambda run, heartbeat, context: RecorderNode(
            open_bag(bag, resolved), run, heartbeat, context
        ),
        COUPLER: CouplerNode,
    }


def run_nodes(
    resolved: ResolvedScene, bag: Path, soil: Callable[[], SpringSoil], observer: RunObserver | None = None
) -> ExitStatus:
    """A composed run around the small engines."""
    (tool,) = resolved.scene.tools
    nodes = builds(resolved, bag, partial(SpringMover, tool), soil)
    return run_composed(RunSettings(resolved, "test"), nodes, observer)


def run_without_ros(resolved: ResolvedScene, bag: Path, soil: SpringSoil) -> None:
    """The same by the direct run."""
    (tool,) = resolved.scene.tools
    simulate(RunSettings(resolved, "test", bag=bag), motion_source=SpringMover(tool), soil=soil)


def contents(bag: Path) -> list[tuple[str, int, bytes]]:
    """Messages of a bag without wall time and padding."""
    return [
        (topic, time, data[: -8 if "report" in topic else None].rstrip(b"\0"))
        for topic, time, data in messages(bag)
    ]


def test_nodes_record_what_the_direct_run_records(resolved: ResolvedScene, tmp_path: Path) -> None:
    """Message for message, every tick once."""
    assert run_nodes(resolved, tmp_path / "nodes", SpringSoil) == ExitStatus()
    run_without_ros(resolved, tmp_path / "direct", SpringSoil())
    assert contents(tmp_path / "nodes") == contents(tmp_path / "direct")
    ticks = lockstep_ticks(tmp_path / "nodes", resolved.timing.communication_step_ns)
    assert ticks == {name: list(range(TICKS)) for name in ticks}
    start = [topic for topic, time_ns, _ in messages(tmp_path / "nodes") if time_ns == 0]
    for name in ("tool_motions", "tool_wrenches", "mechanism_state", "soil_state", "coupling_report"):
        assert start.count(f"/subsoil/{name}") == 1


def test_nodes_that_know_no_batches(
    resolved: ResolvedScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every message goes by itself; the same record."""
    without = {node: tuple(set(can) - {BATCHES}) for node, can in heartbeat.CAPABILITIES.items()}
    monkeypatch.setattr(heartbeat, "CAPABILITIES", without)
    assert run_nodes(resolved, tmp_path / "nodes", SpringSoil) == ExitStatus()
    run_without_ros(resolved, tmp_path / "direct", SpringSoil())
    assert contents(tmp_path / "nodes") == contents(tmp_path / "direct")


def test_clouds_are_thinned_alike(tmp_path: Path) -> None:
    """Region and rounding are applied before the cloud leaves its maker, in both ways."""
    thinned = ["record.cloud_resolution_m=0.01", "record.cloud_region={x_m: [-9.0, 9.0]}"]
    resolved = load_scene(SCENE, [*CHANGES, *thinned])
    assert run_nodes(resolved, tmp_path / "nodes", SpringSoil) == ExitStatus()
    run_without_ros(resolved, tmp_path / "direct", SpringSoil())
    run_without_ros(load_scene(SCENE, CHANGES), tmp_path / "exact", SpringSoil())
    assert contents(tmp_path / "nodes") == contents(tmp_path / "direct") != contents(tmp_path / "exact")


def test_a_fault_of_an_engine_cuts_the_record_alike(resolved: ResolvedScene, tmp_path: Path) -> None:
    """An engine fails at tick 17: the run ends with its words, the bag with tick 16, in both ways."""
    status = run_nodes(resolved, tmp_path / "nodes", lambda: SpringSoil(fail_tick=17))
    assert status == ExitStatus(3, "soil: tick 17: overlap too deep")
    with pytest.raises(PhysicsError, match="tick 17: overlap too deep"):
        run_without_ros(resolved, tmp_path / "direct", SpringSoil(fail_tick=17))
    assert contents(tmp_path / "nodes") == contents(tmp_path / "direct")
    ticks = lockstep_ticks(tmp_path / "nodes", resolved.timing.communication_step_ns)
    assert ticks == {name: list(range(17)) for name in ticks}


def test_invented_energy_ends_the_run_alike(resolved: ResolvedScene, tmp_path: Path) -> None:
    """The soil reports three times its work: the residual's bound ends the run, at the same tick."""
    status = run_nodes(resolved, tmp_path / "nodes", lambda: SpringSoil(invented=3.0))
    assert status.code == 3
    with pytest.raises(PhysicsError) as raised:
        run_without_ros(resolved, tmp_path / "direct", SpringSoil(invented=3.0))
    assert status.reason == str(raised.value)
    assert contents(tmp_path / "nodes") == contents(tmp_path / "direct")


def test_an_engine_that_cannot_be_built_ends_the_run(resolved: ResolvedScene, tmp_path: Path) -> None:
    """A fault before tick 0 reaches every node; the bag is closed."""

    def broken() -> SpringSoil:
        raise RunError("no bed")

    assert run_nodes(resolved, tmp_path / "bag", broken) == ExitStatus(3, "soil: no bed")
    assert messages(tmp_path / "bag") == []


def test_bad_input_of_an_engine_stays_bad_input(resolved: ResolvedScene, tmp_path: Path) -> None:
    """What only a node finds as it starts ends the run with 2: as it is built, and as it first answers."""

    def unbuildable() -> SpringSoil:
        raise InputError("tools: they overlap every particle")

    class Refusing(SpringSoil):
        def start(self, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
            raise InputError("tools: they overlap every particle")

    for name, soil in (("build", unbuildable), ("start", Refusing)):
        status = run_nodes(resolved, tmp_path / name, soil)
        assert status == ExitStatus(2, "soil: tools: they overlap every particle")


def test_paths_are_hosted_by_the_soil(tmp_path: Path) -> None:
    """Without mechanism the soil node moves the tools itself and publishes the motions."""
    scene = load_scene(SCENE.parent / "tine.yaml", ["duration_s=0.002"])
    (tool,) = scene.scene.tools
    writer = open_bag(tmp_path / "bag", scene)
    nodes: dict[str, Build] = {
        SOIL: lambda run, heartbeat, context: SoilNode(
            SpringSoil(), SpringMover(tool), run, heartbeat, context
        ),
        RECORDER: lambda run, heartbeat, context: RecorderNode(writer, run, heartbeat, context),
        COUPLER: CouplerNode,
    }
    assert run_composed(RunSettings(scene, "test"), nodes) == ExitStatus()
    run_without_ros(scene, tmp_path / "direct", SpringSoil())
    assert contents(tmp_path / "bag") == contents(tmp_path / "direct")


class GatedSoil(SpringSoil):
    """Stands at tick 3 until the gate opens."""

    def __init__(self, gate: threading.Event, at: threading.Event) -> None:
        super().__init__()
        self._gate = gate
        self._at = at

    def advance(self, tick: int, motions: tuple[ToolMotion, ...]) -> tuple[ToolWrench, ...]:
        if tick == 3:
            self._at.set()
            assert self._gate.wait(LIMIT_S)
        return super().advance(tick, motions)


def status_with_unknown_publisher(
    resolved: ResolvedScene, bag: Path, listener: Node, topic: str, message: Any
) -> ExitStatus:
    """How a run ends whose soil stands at tick 3 while a foreign node publishes on a lockstep topic."""
    gate, at = threading.Event(), threading.Event()
    statuses: list[ExitStatus] = []
    runner = threading.Thread(
        target=lambda: statuses.append(run_nodes(resolved, bag, lambda: GatedSoil(gate, at)))
    )
    runner.start()
    assert at.wait(LIMIT_S)
    publisher = listener.create_publisher(type(message), topic, LOCKSTEP_QOS)
    deadline = time.monotonic() + 3.0  # the run may have ended because of the publisher
    while (
        publisher.get_subscription_count() < 3 and time.monotonic() < deadline
    ):  # two nodes and the recorder
        time.sleep(0.001)
    publisher.publish(message)
    time.sleep(0.3)
    gate.set()
    runner.join(LIMIT_S)
    (status,) = statuses
    return status


@pytest.fixture
def listener() -> Iterator[Node]:
    """A foreign node in the same domain."""
    context = Context()
    rclpy.init(context=context)
    node = Node("stranger", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_others_follow_clock_and_poses_live(resolved: ResolvedScene, tmp_path: Path, listener: Node) -> None:
    """/clock is the end of each tick, poses come at series ticks; whoever listens gets them."""
    (tool,) = resolved.scene.tools
    clocks: list[int] = []
    poses: list[float] = []
    qos = LOCKSTEP_QOS.depth
    clock = listener.create_subscription(Clock, "/clock", lambda m: clocks.append(m.clock.nanosec), qos)
    pose = listener.create_subscription(
        PoseStamped, f"tool/{tool}/pose", lambda m: poses.append(m.pose.position.x), qos
    )
    gate, at = threading.Event(), threading.Event()
    statuses: list[ExitStatus] = []
    runner = threading.Thread(
        target=lambda: statuses.append(run_nodes(resolved, tmp_path / "bag", lambda: GatedSoil(gate, at)))
    )
    runner.start()
    executor = SingleThreadedExecutor(context=listener.context)
    executor.add_node(listener)
    assert at.wait(LIMIT_S)
    while not (clock.get_publisher_count() and pose.get_publisher_count()):
        executor.spin_once(timeout_sec=0.05)
    gate.set()
    last_ns = TICKS * resolved.timing.communication_step_ns
    while runner.is_alive() and not (clocks and clocks[-1] == last_ns):
        executor.spin_once(timeout_sec=0.05)
    runner.join()
    assert statuses == [ExitStatus()]
    late = time.monotonic() + LIMIT_S
    while clocks[-1] != last_ns and time.monotonic() < late:
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    assert (
        clocks
        == [(tick + 1) * resolved.timing.communication_step_ns for tick in range(TICKS)][-len(clocks) :]
    )
    assert poses == sorted(poses)
    assert poses[-1] > 0.0


def test_a_foreign_message_ends_the_run_by_name(
    resolved: ResolvedScene, tmp_path: Path, listener: Node
) -> None:
    """A foreign node publishes motions of another run on our topic: refused, named, exit 3."""
    message = ToolMotionsMessage(run_id="other", tick=4)
    message.header.stamp.nanosec = 5 * resolved.timing.communication_step_ns
    status = status_with_unknown_publisher(resolved, tmp_path / "bag", listener, "tool_motions", message)
    assert status.code == 3
    assert "tool_motions: " in status.reason
    assert "ROS_DOMAIN_ID of its own" in status.reason
