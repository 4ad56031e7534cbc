"""What a ROS developer expects of the nodes: parameters, diagnostics, live topics, namespaces."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.exit_status import ExitStatus
from subsoil_ros.coupling.protocol import COUPLER, MECHANISM, RECORDER, SOIL
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.errors import InputError
from subsoil_ros.loading.loader import ResolvedScene
from subsoil_ros.recording.bag_writer import open_bag
from subsoil_ros.ros.nodes.composed import Build, run_composed
from subsoil_ros.ros.nodes.recorder_node import RecorderNode
from subsoil_ros.ros.process.parameters import PARAMETERS, read_settings
from subsoil_ros.ros.transport.qos import LATCHED_QOS
from tests.system.conftest import SCENE, messages
from tests.system.test_nodes import (
    LIMIT_S,
    GatedSoil,
    SpringMover,
    SpringSoil,
    _own_domain,  # noqa: F401 (a fixture)
    builds,
    contents,
    listener,  # noqa: F401 (a fixture)
    resolved,  # noqa: F401 (a fixture)
)

DURABILITIES = {"volatile": DurabilityPolicy.VOLATILE, "kept": DurabilityPolicy.TRANSIENT_LOCAL}


@pytest.fixture
def process_node() -> Iterator[Callable[..., Node]]:
    """Makes nodes named as a node's process, with command line arguments."""
    context = Context()
    rclpy.init(context=context)
    made: list[Node] = []

    def make(name: str, *words: str) -> Node:
        made.append(Node(name, context=context, cli_args=["--ros-args", *words]))
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()
    rclpy.shutdown(context=context)


def test_parameters_describe_themselves(process_node: Callable[..., Node]) -> None:
    """Each has a description and what is allowed, is read-only, and counts have a range."""
    node = process_node("soil_process", "-p", f"scene:={SCENE}", "-p", "threads:=2")
    settings = read_settings(node, "soil")
    assert (settings.resolved.path, settings.threads, settings.recorded) == (SCENE, 2, True)
    for name in PARAMETERS:
        described = node.describe_parameter(name)
        assert described.description
        assert described.additional_constraints
        assert described.read_only
    (limits,) = node.describe_parameter("threads").integer_range
    assert (limits.from_value, limits.to_value) == (1, 1024)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["-p", "threads:=0"], "parameter 'threads': must be a whole number from 1 to 1024"),
        (["-p", "threads:=many"], "parameter 'threads': must be a whole number"),
        (["-p", "run_id:=7"], "parameter 'run_id': must be text; a number in quotes is one too"),
        (["-p", "thread:=2"], "parameter 'thread': not known; allowed are bag, checkpoints,"),
        (["-p", "recorded:=2"], "parameter 'recorded': must be true or false"),
        (["-r", "__node:=mud"], "the node was renamed to 'mud'"),
        ([], "parameter 'scene' is empty"),
    ],
    ids=["zero", "text", "number", "unknown", "flag", "renamed", "no scene"],
)
def test_a_parameter_that_cannot_be_is_refused(
    process_node: Callable[..., Node], words: list[str], expected: str
) -> None:
    """One message with name, value and what is allowed."""
    with pytest.raises(InputError) as raised:
        read_settings(process_node("soil_process", *words), "soil")
    assert str(raised.value).startswith(expected)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["--ros-args", "-p", "threads:=0", "-r", "__ns:=/field"],
            "[field.soil_process]: parameter 'threads': must be",
        ),
        (["--ros-args", "-p", "treads:=2"], "[soil_process]: parameter 'treads': not known; allowed are"),
        (["--ros-args", "-p", "threads"], "soil: no ROS node can be made: "),
        (["--threads=2"], "soil: argument '--threads=2': not known; give --ros-args -p NAME:=VALUE"),
    ],
    ids=["value", "name", "syntax", "no ROS"],
)
def test_a_process_says_it_in_one_line(words: list[str], expected: str) -> None:
    """The same from the command line: exit 2, one message, no traceback."""
    done = run_soil_node(*words)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert expected in line


def run_soil_node(*words: str) -> subprocess.CompletedProcess[str]:
    """The soil node where `ros2 run` finds it."""
    return subprocess.run(
        [Path(sys.prefix) / "lib" / "subsoil_ros" / "soil_node", *words],
        capture_output=True, text=True, timeout=LIMIT_S, check=False,
    )  # fmt: skip


def test_help_prints_the_parameters() -> None:
    """Each with its default, on standard output, status 0; no scene is needed."""
    done = run_soil_node("--help")
    assert (done.returncode, done.stderr) == (0, "")
    for name, key in PARAMETERS.items():
        assert f"  {name} (default: " in done.stdout
        assert key.description in done.stdout


def described_builds(
    resolved: ResolvedScene,  # noqa: F811
    bag: Path,
    soil: Callable[[], SpringSoil] = SpringSoil,
) -> dict[str, Build]:
    """All four nodes around small engines, the bag with its description of the machine."""
    (tool,) = resolved.scene.tools
    nodes = builds(resolved, bag, partial(SpringMover, tool), soil)
    nodes[RECORDER] = lambda run, heartbeat, context: RecorderNode(
        open_bag(bag, resolved), run, heartbeat, context
    )
    return nodes


class Run:
    """A composed run in a thread of its own."""

    def __init__(self, scene: ResolvedScene, nodes: dict[str, Build], namespace: str = "") -> None:
        self._statuses: list[ExitStatus] = []
        run = RunSettings(scene, "test")
        self._thread = threading.Thread(
            target=lambda: self._statuses.append(run_composed(run, nodes, namespace=namespace))
        )
        self._thread.start()

    def is_alive(self) -> bool:
        """Whether it goes on."""
        return self._thread.is_alive()

    def status(self) -> ExitStatus:
        """How it ended."""
        self._thread.join(LIMIT_S)
        (status,) = self._statuses
        return status


def spin(node: Node, until: Callable[[], Any]) -> None:
    """Serves a node until something is so."""
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    deadline = time.monotonic() + LIMIT_S
    while not until():
        assert time.monotonic() < deadline
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()


def test_nodes_say_how_they_do(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
) -> None:
    """Once a second from all four, with rates and residuals; the last word of a failure is its reason."""
    heard: dict[str, list[DiagnosticStatus]] = {}

    def hear(message: DiagnosticArray) -> None:
        assert message.header.stamp.sec > 0
        for status in message.status:
            heard.setdefault(status.name, []).append(status)

    listener.create_subscription(DiagnosticArray, "/diagnostics", hear, 100)
    gate, at = threading.Event(), threading.Event()

    class StallingSoil(GatedSoil):
        """Stands at tick 3 until the gate opens, fails at tick 40."""

        def advance(self, tick: int, motions: Any) -> Any:
            self._fail_tick = 40
            return super().advance(tick, motions)

    run = Run(resolved, described_builds(resolved, tmp_path / "bag", lambda: StallingSoil(gate, at)))
    names = {f"{name}: lockstep" for name in (MECHANISM, SOIL, RECORDER, COUPLER)}
    others = names - {"soil: lockstep"}  # which computes
    spin(listener, lambda: at.is_set() and all(len(heard.get(name, ())) > 1 for name in others))
    running = heard["coupler: lockstep"][-1]
    values = {item.key: item.value for item in running.values}
    assert (running.level, running.hardware_id, running.message) == (b"\0", "test", "running")
    assert values["tick"] == "2"
    assert float(values["residual_bound"]) == resolved.scene.coupling.residual_bound
    assert float(values["interface_residual_ratio"]) > 0.0
    assert {"ticks_per_s", "real_time_factor", "tick_time_median_s", "recorder_lag_ticks"} <= set(values)
    gate.set()
    spin(listener, lambda: all(heard.get(name, [DiagnosticStatus()])[-1].level == b"\2" for name in names))
    assert run.status() == ExitStatus(3, "soil: tick 40: overlap too deep")
    assert heard["soil: lockstep"][-1].message == "tick 40: overlap too deep"
    assert set(heard) == names


def test_parameters_are_answered_while_an_engine_computes(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
) -> None:
    """list, get and describe, of all eight nodes that `ros2 param list` asks, each within two seconds."""
    gate, at = threading.Event(), threading.Event()
    run = Run(resolved, described_builds(resolved, tmp_path / "bag", lambda: GatedSoil(gate, at)))
    assert at.wait(LIMIT_S)  # the soil computes: it takes no message
    names = [name for node in (MECHANISM, SOIL, RECORDER, COUPLER) for name in (node, f"{node}_process")]
    spin(listener, lambda: set(names) <= set(listener.get_node_names()))
    for name in names:
        begin = time.monotonic()
        listed = call(listener, ListParameters, f"{name}/list_parameters", depth=0)
        assert "use_sim_time" in listed.result.names
        (value,) = call(listener, GetParameters, f"{name}/get_parameters", names=["use_sim_time"]).values
        assert value.bool_value is False
        asked = call(listener, DescribeParameters, f"{name}/describe_parameters", names=["use_sim_time"])
        assert [item.name for item in asked.descriptors] == ["use_sim_time"]
        assert time.monotonic() - begin < 2.0
    gate.set()
    assert run.status() == ExitStatus()


def call(node: Node, kind: type, name: str, **request: Any) -> Any:
    """The answer of a service."""
    client = node.create_client(kind, name)
    spin(node, client.service_is_ready)
    future = client.call_async(kind.Request(**request))
    spin(node, future.done)
    node.destroy_client(client)
    return future.result()


def test_what_nodes_log_is_on_rosout(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
) -> None:
    """Readiness and the start at INFO, the reason of a failure at ERROR from the node itself, by name."""
    heard: list[tuple[str, int, str]] = []
    rosout = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    listener.create_subscription(
        Log, "/rosout", lambda log: heard.append((log.name, log.level, log.msg)), rosout
    )
    info, error = Log.INFO, Log.ERROR
    run = Run(resolved, described_builds(resolved, tmp_path / "bag", lambda: SpringSoil(fail_tick=7)))
    expected = {
        (MECHANISM, info, "ready for run 'test'; waits for the first grant of coupler"),
        (SOIL, info, "ready for run 'test'; waits for the first grant of coupler"),
        (COUPLER, info, "run 'test': running after tick -1"),
        (SOIL, error, "tick 7: overlap too deep"),
        (COUPLER, error, "soil: tick 7: overlap too deep"),
        (RECORDER, error, "run aborted at tick 6: soil: tick 7: overlap too deep"),
    }
    spin(listener, lambda: expected <= set(heard))
    assert run.status().code == 3


@pytest.mark.parametrize("durability", DURABILITIES.values(), ids=DURABILITIES)
def test_a_late_display_sees_the_tools(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
    durability: DurabilityPolicy,
) -> None:
    """Also with the default of a display of RViz, volatile; once each, whatever the durability."""
    qos = QoSProfile(depth=5, durability=durability)
    gate, at = threading.Event(), threading.Event()
    run = Run(resolved, described_builds(resolved, tmp_path / "bag", lambda: GatedSoil(gate, at)))
    assert at.wait(LIMIT_S)
    heard: dict[str, list[Any]] = {"robot_description": [], "tool_markers": []}
    listener.create_subscription(String, "/robot_description", heard["robot_description"].append, qos)
    listener.create_subscription(MarkerArray, "/tool_markers", heard["tool_markers"].append, qos)
    spin(listener, lambda: all(heard.values()))
    (markers,) = heard["tool_markers"]
    assert [marker.type for marker in markers.markers] == [Marker.TRIANGLE_LIST] * len(markers.markers)
    assert heard["robot_description"][0].data.startswith("<?xml")
    gate.set()
    assert run.status() == ExitStatus()
    assert {name: len(messages) for name, messages in heard.items()} == dict.fromkeys(heard, 1)


def test_live_topics_carry_the_bytes_of_the_bag(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
) -> None:
    """Who comes late still hears of the machine and its tools; poses and clock follow; all as in the bag."""
    (tool,) = resolved.scene.tools
    heard: dict[str, list[bytes]] = {}

    def listen(kind: type, topic: str, name: str, qos: Any = 100) -> None:
        heard[name] = []
        listener.create_subscription(kind, topic, heard[name].append, qos, raw=True)

    gate, at = threading.Event(), threading.Event()
    run = Run(resolved, described_builds(resolved, tmp_path / "bag", lambda: GatedSoil(gate, at)))
    assert at.wait(LIMIT_S)
    pose = f"tool/{tool}/pose"
    listen(String, "/robot_description", "/robot_description", LATCHED_QOS)
    listen(MarkerArray, "/tool_markers", "/subsoil/tool_markers", LATCHED_QOS)
    listen(PoseStamped, f"/{pose}", f"/subsoil/{pose}")
    listen(Clock, "/clock", "/clock")
    matched = [item for item in listener.subscriptions]
    spin(listener, lambda: all(item.get_publisher_count() == 1 for item in matched))
    spin(listener, lambda: heard["/robot_description"] and heard["/subsoil/tool_markers"])
    gate.set()
    spin(listener, lambda: not run.is_alive())
    assert run.status() == ExitStatus()
    recorded: dict[str, list[bytes]] = {}
    for topic, _, data in messages(tmp_path / "bag"):
        recorded.setdefault(topic, []).append(data.rstrip(b"\0"))
    for topic, live in heard.items():
        assert len(live) > 0
        first = recorded[topic].index(live[0].rstrip(b"\0"))  # who listens later hears later ones
        assert [data.rstrip(b"\0") for data in live] == recorded[topic][first : first + len(live)]
    assert len(recorded["/robot_description"]) == len(recorded["/subsoil/tool_markers"]) == 1
    begin = [topic for topic, _, _ in messages(tmp_path / "bag")][:2]
    assert begin == ["/robot_description", "/subsoil/tool_markers"]


def test_tf_moves_live(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
) -> None:
    """/tf as in the bag, each time with the body further on; test_colcon.py runs this where there is none."""
    kinds = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is in no package registry")
    heard: list[bytes] = []
    gate, at = threading.Event(), threading.Event()
    run = Run(resolved, described_builds(resolved, tmp_path / "bag", lambda: GatedSoil(gate, at)))
    assert at.wait(LIMIT_S)
    subscription = listener.create_subscription(kinds.TFMessage, "/tf", heard.append, 100, raw=True)
    spin(listener, lambda: subscription.get_publisher_count() == 1)
    gate.set()
    spin(listener, lambda: not run.is_alive())
    assert run.status() == ExitStatus()
    recorded = [data.rstrip(b"\0") for topic, _, data in messages(tmp_path / "bag") if topic == "/tf"]
    assert len(heard) > 1
    assert [data.rstrip(b"\0") for data in heard] == recorded[-len(heard) :]
    found = [deserialize_message(data, kinds.TFMessage).transforms[0] for data in heard]
    assert {item.header.frame_id for item in found} == {"world"}
    places_m = [item.transform.translation.x for item in found]
    assert len(set(places_m)) == len(places_m)


def test_two_runs_share_a_domain_in_namespaces(
    resolved: ResolvedScene,  # noqa: F811
    tmp_path: Path,
    listener: Node,  # noqa: F811
) -> None:
    """Two runs of one name at once, each in its namespace: the bags of undisturbed runs, two clocks."""
    gate, at = threading.Event(), [threading.Event(), threading.Event()]
    names = ("/left", "/field/right")
    runs = [
        Run(resolved, described_builds(resolved, tmp_path / str(k), partial(GatedSoil, gate, at[k])), name)
        for k, name in enumerate(names)
    ]
    assert all(event.wait(LIMIT_S) for event in at)  # both stand in tick 3
    own = [f"{name}/{topic}" for name in names for topic in ("clock", "grant", "robot_description")]
    spin(listener, lambda: all(listener.count_publishers(topic) == 1 for topic in own))
    assert listener.count_publishers("/clock") == listener.count_publishers("/grant") == 0
    gate.set()
    assert [run.status() for run in runs] == [ExitStatus(), ExitStatus()]
    (tool,) = resolved.scene.tools
    simulate(
        RunSettings(resolved, "test", bag=tmp_path / "direct"),
        motion_source=SpringMover(tool),
        soil=SpringSoil(),
    )
    for k in range(2):
        assert contents(tmp_path / str(k)) == contents(tmp_path / "direct")


@pytest.mark.full
def test_two_subsoil_runs_share_a_domain(tmp_path: Path) -> None:
    """The same as a user does it: processes, one ROS_DOMAIN_ID; the series of a direct run, to the byte."""
    scene = str(SCENE.parent / "mechanism_only.yaml")
    command = [sys.executable, "-m", "subsoil_ros.cli.main", "run", scene, "--set", "duration_s=0.2"]
    alone = subprocess.run([*command, "--mode", "direct", "--out", tmp_path / "direct"], check=False)
    assert alone.returncode == 0
    running = [
        subprocess.Popen(
            [*command, "--out", str(tmp_path / name), "--namespace", name],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=dict(os.environ), text=True,
        )
        for name in ("left", "right")
    ]  # fmt: skip
    words = [process.communicate(timeout=3.0 * LIMIT_S)[1] for process in running]
    assert [process.returncode for process in running] == [0, 0], words
    expected = (tmp_path / "direct" / "series.csv").read_bytes()
    for name in ("left", "right"):
        assert (tmp_path / name / "series.csv").read_bytes() == expected
