"""launch/subsoil.launch.py starts what `subsoil run` starts; by launch itself where that is installed.

launch is in no package registry. Where it is missing, small stand-ins take what the file hands to it, and the
processes are started from that as launch_ros would.
"""

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numba
import pytest
import yaml

from subsoil_ros.api.read import read_run
from subsoil_ros.api.run_frame import RunFrame
from subsoil_ros.cli.main import main
from subsoil_ros.coupling.engines import MotionSource, build_motion_source
from subsoil_ros.coupling.external import Machine
from subsoil_ros.errors import InputError, RunError
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import SoilCloud
from subsoil_ros.recording.topics import LATCHED, TOPIC_OF
from subsoil_ros.ros.process.node_plan import nodes_of
from subsoil_ros.ros.transport import shared_memory
from subsoil_ros.ros.transport.ros_domain import run_domain
from subsoil_ros.ros.transport.shared_memory import LOADED_BYTES, TRANSPORTS
from tests.system.conftest import SCENE
from tests.system.test_nodes import contents

FILE = Path(__file__).parents[2] / "launch" / "subsoil.launch.py"
MACHINE = SCENE.parent / "mechanism_only.yaml"
SHORT = "duration_s=0.05"
LIMIT_S = 120.0
HAS_LAUNCH = importlib.util.find_spec("launch_ros") is not None


class Taken(SimpleNamespace):
    """Something that was handed to launch: its kind, and its arguments."""


class Configuration:
    """The value of a launch argument, by name."""

    def __init__(self, name: str) -> None:
        self.name = name

    def perform(self, context: Any) -> str:
        """Its value."""
        return context.launch_configurations[self.name]


def kind(name: str) -> Callable[..., Taken]:
    """A class of launch that only remembers what it is made with."""
    return lambda *values, **keys: Taken(kind=name, values=values, **keys)


def stand_ins(share: Path) -> dict[str, ModuleType]:
    """The modules that the launch file imports."""
    names = {
        "launch": ("LaunchContext", "LaunchDescription", "LaunchDescriptionEntity"),
        "launch.actions": (
            "DeclareLaunchArgument",
            "ExecuteProcess",
            "LogInfo",
            "OpaqueFunction",
            "TimerAction",
        ),
        "launch.events": (),
        "launch.events.process": ("ProcessExited",),
        "launch_ros": (),
        "launch_ros.actions": ("Node", "SetParameter"),
    }
    modules = {name: ModuleType(name) for name in names}
    for name, classes in names.items():
        for item in classes:
            setattr(modules[name], item, kind(item))
    others: dict[str, dict[str, Any]] = {
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros.parameter_descriptions": {
            "ParameterValue": lambda value, value_type: SimpleNamespace(value=value_type(value))
        },
        "ament_index_python.packages": {"get_package_share_directory": lambda name: str(share)},
    }
    for name, items in others.items():
        modules[name] = ModuleType(name)
        vars(modules[name]).update(items)
    return modules


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., list[Taken]]]:
    """Hands launch arguments to the file; gives what it starts."""
    for name, module in stand_ins(FILE.parents[1]).items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("subsoil_launch", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def start(**given: str) -> list[Taken]:
        (description,) = module.generate_launch_description().values
        declared = {
            item.values[0]: item.default_value for item in description if item.kind == "DeclareLaunchArgument"
        }
        assert set(given) <= set(declared)
        (function,) = [item.function for item in description if item.kind == "OpaqueFunction"]
        (sim_time,) = [item.values for item in description if item.kind == "SetParameter"]
        assert (sim_time[0], sim_time[1].name) == ("use_sim_time", "use_sim_time")
        return function(SimpleNamespace(launch_configurations={**declared, **given}))

    return start


def parameters(node: Taken) -> dict[str, Any]:
    """What a node is told."""
    (given,) = node.parameters
    return {key: value.value for key, value in given.items()}


def test_it_starts_what_subsoil_run_starts(
    start: Callable[..., list[Taken]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same executables with the same parameters as `subsoil run`, but for who holds standard input."""
    frames: list[RunFrame] = []
    monkeypatch.setattr("subsoil_ros.cli.run.simulation._run_nodes", lambda run, *_: frames.append(run))
    scene = SCENE.parent / "subsoiler_1s300_wedge.yaml"
    assert main(["run", str(scene), "--out", str(tmp_path / "run"), "--threads", "2", "--paused"]) != 0
    settings = frames[0].settings  # nothing was recorded
    assert settings.supervised
    words, *nodes = start(out=str(tmp_path / "launched"), threads="2", paused="true", recording="true")
    launched = [(node.package, node.executable, parameters(node)) for node in nodes]
    run_id = launched[0][2]["run_id"]
    assert run_id in words.msg
    expected = replace(
        settings, run_id=run_id, supervised=False, bag=tmp_path / "launched/bag",
        checkpoints=tmp_path / "launched/checkpoints",
    )  # fmt: skip
    assert launched == [
        ("subsoil_ros", node.executable, dict(node.parameters))
        for node in nodes_of(expected, tmp_path / "launched/scene.yaml")
    ]
    assert (tmp_path / "launched/scene.yaml").read_text() == (tmp_path / "run/scene.yaml").read_text()
    lib = FILE.parents[1] / "scripts"
    assert all((lib / node.executable).is_file() for node in nodes)


def test_what_it_starts_makes_the_run(
    start: Callable[..., list[Taken]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its processes, with use_sim_time and in a namespace: the series of a direct run, as many messages."""
    out = tmp_path / "launched"
    _, *nodes = start(
        scene=str(MACHINE), out=str(out), overrides=f"{SHORT} record.cloud_hz=0", namespace="field"
    )
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with run_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        running = []
        for node in nodes:
            command = [sys.executable, "-m", f"subsoil_ros.ros.nodes.{node.executable}", "--ros-args"]
            command += [*node.ros_arguments, "-r", f"__ns:={node.namespace}", "-p", "use_sim_time:=true"]
            command += [word for old, new in node.remappings for word in ("-r", f"{old}:={new}")]
            for key, value in parameters(node).items():
                command += ["-p", f"{key}:={json.dumps(value)}"]
            running.append(subprocess.Popen(command, stdin=subprocess.DEVNULL))
        try:
            assert [process.wait(LIMIT_S) for process in running] == [0] * len(running)
        finally:
            for process in running:
                process.kill()
    direct = ["run", str(MACHINE), "--mode", "direct", "--out", str(tmp_path / "direct"), "--set", SHORT]
    assert main([*direct, "--set", "record.cloud_hz=0"]) == 0
    assert main(["report", str(out)]) == 0
    assert (out / "series.csv").read_bytes() == (tmp_path / "direct/series.csv").read_bytes()
    assert contents(out / "bag") == contents(tmp_path / "direct/bag")
    launched, alone = (
        json.loads((path / "summary.json").read_text())["run"]["state_sha256"]
        for path in (out, tmp_path / "direct")
    )
    assert sorted(launched) == ["coupling", "mechanism"]
    assert launched == alone
    (out / "series.csv").unlink()
    (out / "summary.json").unlink()
    assert read_run(out).summary["run"]["state_sha256"] == alone


def test_rviz_shows_what_is_published(start: Callable[..., list[Taken]], tmp_path: Path) -> None:
    """Beside the nodes, with the installed file; its topics are those of a run, in the namespace."""
    given = {"scene": str(MACHINE), "overrides": "record.cloud_hz=0", "namespace": "left"}
    _, *nodes = start(out=str(tmp_path / "out"), rviz="true", **given)
    *_, viewer = nodes
    assert (viewer.package, viewer.executable) == ("rviz2", "rviz2")
    assert viewer.parameters == [{"use_sim_time": True}]
    file = Path(viewer.arguments[1])
    shown = yaml.safe_load(file.read_text())["Visualization Manager"]["Displays"]
    topics = {item.get("Topic", item.get("Description Topic", {})).get("Value") for item in shown} - {None}
    remapped = dict(viewer.remappings)
    assert topics <= set(remapped)
    known = {"/clock", "/tf", f"/{TOPIC_OF[SoilCloud]}", *(f"/{topic.lstrip('/')}" for topic in LATCHED)}
    assert set(remapped) == known
    assert remapped["/soil/points"] == "/left/soil/points"
    _, *without = start(out=str(tmp_path / "other"), **given)
    assert [node.executable for node in without] == [node.executable for node in nodes[:-1]]


def test_other_modes_are_left_to_subsoil_run(start: Callable[..., list[Taken]], tmp_path: Path) -> None:
    """composed and direct: `subsoil run`, which gets every argument and makes the folder itself."""
    (process,) = start(
        scene=str(MACHINE), out=str(tmp_path / "out"), mode="composed", namespace="field", paused="true",
        overrides="duration_s=0.1 'gravity_m_per_s2=9.8'", resume="runs/before",
    )  # fmt: skip
    assert process.kind == "ExecuteProcess"
    assert process.cmd[1:] == [
        "-m", "subsoil_ros.cli.main", "run", str(MACHINE), "--out", str(tmp_path / "out"),
        "--mode", "composed",
        "--namespace=/field", "--threads=1", "--ranks=1", "--paused", "--resume", "runs/before",
        "--set", "duration_s=0.1", "--set", "gravity_m_per_s2=9.8",
    ]  # fmt: skip
    assert not (tmp_path / "out").exists()


def exit_of(node: Taken, status: int, name: str, shut_down: bool = False) -> Taken | None:
    """What launch is told to do when a node's process has ended."""
    context = SimpleNamespace(is_shutdown=shut_down)
    return node.on_exit(SimpleNamespace(returncode=status, process_name=name), context)


@pytest.mark.parametrize("status", [3, -9])
def test_a_node_that_fails_ends_the_launch(
    start: Callable[..., list[Taken]], tmp_path: Path, status: int
) -> None:
    """With an error that names it, when the others have ended or after some time; launch then ends with 1."""
    _, mechanism, recorder, coupler = start(scene=str(MACHINE), out=str(tmp_path / "out"))
    timer = exit_of(mechanism, status, "mechanism_node-1")
    assert timer is not None
    assert (timer.kind, timer.period) == ("TimerAction", 15.0)
    words = f"the run failed: mechanism_node-1 ended with status {status}$"
    with pytest.raises(RunError, match=words):
        timer.actions[0].function(None)
    assert exit_of(recorder, 3, "recorder_node-2") is None
    with pytest.raises(RunError, match=words):
        exit_of(coupler, 3, "coupler_node-3")


def test_nodes_that_end_in_order_end_nothing(start: Callable[..., list[Taken]], tmp_path: Path) -> None:
    """So that the recorder can close the bag. After Ctrl-C only the last one that ends tells launch."""
    _, *nodes = start(scene=str(MACHINE), out=str(tmp_path / "out"))
    assert [exit_of(node, 0, "node") for node in nodes] == [None] * 3
    _, *nodes = start(scene=str(MACHINE), out=str(tmp_path / "other"))
    assert [exit_of(node, 130, "node", shut_down=True) for node in nodes[:2]] == [None] * 2
    with pytest.raises(RunError, match="ended with status 130"):
        exit_of(nodes[2], 130, "node", shut_down=True)


def test_a_run_that_subsoil_run_refuses_ends_the_launch(
    start: Callable[..., list[Taken]], tmp_path: Path
) -> None:
    """Its message stands on the screen; launch ends with 1."""
    (process,) = start(scene=str(MACHINE), out=str(tmp_path / "out"), mode="foo")
    with pytest.raises(RunError, match="python-1 ended with status 2"):
        exit_of(process, 2, "python-1")


def test_it_looks_for_room_in_shared_memory(
    start: Callable[..., list[Taken]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once for all nodes, which get its environment: UDP with one line, or an end before anything is made."""
    monkeypatch.setenv(TRANSPORTS, "")
    monkeypatch.setattr(shared_memory, "free_bytes", lambda: LOADED_BYTES)
    notice, *_ = start(scene=str(MACHINE), out=str(tmp_path / "out"))
    assert "messages go by UDP" in notice.msg
    assert os.environ[TRANSPORTS] == "UDPv4"
    monkeypatch.setattr(shared_memory, "free_bytes", lambda: LOADED_BYTES - 1)
    with pytest.raises(InputError, match="is full"):
        start(scene=str(MACHINE), out=str(tmp_path / "other"))
    assert not (tmp_path / "other").exists()


def test_it_goes_on_from_an_earlier_run(start: Callable[..., list[Taken]], tmp_path: Path) -> None:
    """resume:=FOLDER hands its newest checkpoint to the nodes; a folder without one is named."""
    kept = f"{SHORT} record.checkpoint_s=0.02"
    words = [word for change in kept.split() for word in ("--set", change)]
    first = tmp_path / "first"
    assert main(["run", str(MACHINE), "--out", str(first), "--mode", "direct", *words]) == 0
    newest = max(path.parent for path in first.glob("checkpoints/*/manifest.json"))
    _, *nodes = start(scene=str(MACHINE), out=str(tmp_path / "second"), overrides=kept, resume=str(first))
    assert {parameters(node)["resume"] for node in nodes} == {str(newest)}
    with pytest.raises(InputError, match=r"^resume .*nowhere: no such folder"):
        start(scene=str(MACHINE), out=str(tmp_path / "third"), resume=str(tmp_path / "nowhere"))
    assert not (tmp_path / "third").exists()


def test_it_says_at_once_that_it_compiles(
    start: Callable[..., list[Taken]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Before the first kernel that is compiled while the run is prepared: on the screen of the launch."""
    said_before: list[str] = []

    def prepare(resolved: ResolvedScene, machine: Machine | None) -> MotionSource:
        numba.njit(lambda x: x + 1)(1)
        said_before.append(capsys.readouterr().err)
        return build_motion_source(resolved, machine)

    monkeypatch.setattr("subsoil_ros.api.run_frame.build_motion_source", prepare)
    start(scene=str(MACHINE), out=str(tmp_path / "out"))
    assert said_before[0].startswith("compiling kernels, once, in 1 to 4 minutes: kept in ")


def test_a_run_without_record(start: Callable[..., list[Taken]], tmp_path: Path) -> None:
    """recording:=false starts no recorder, and every node knows."""
    _, *nodes = start(scene=str(MACHINE), out=str(tmp_path / "out"), recording="false")
    assert [node.executable for node in nodes] == ["mechanism_node", "coupler_node"]
    assert all(parameters(node)["recorded"] is False for node in nodes)
    with pytest.raises(InputError, match="recording: given false"):
        start(scene=str(MACHINE), out=str(tmp_path / "other"), recording="false", mode="direct")


@pytest.mark.parametrize(
    ("name", "value"), [("threads", "0"), ("recording", "maybe"), ("paused", "1"), ("namespace", "2nd")]
)
def test_a_bad_argument_is_named(
    start: Callable[..., list[Taken]], tmp_path: Path, name: str, value: str
) -> None:
    """One message with the argument and what is allowed; no folder is made."""
    with pytest.raises(InputError, match=rf"^{name}: given '{value}'"):
        start(scene=str(MACHINE), out=str(tmp_path / "out"), **{name: value})
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not HAS_LAUNCH, reason="launch_ros is not installed: no package registry has it")
def test_launch_itself_runs_it(tmp_path: Path) -> None:
    """ros2 launch's own service, with the file as it is: the series of a direct run."""
    source = (
        "import sys; from launch import LaunchDescription, LaunchService\n"
        "from launch.actions import IncludeLaunchDescription\n"
        "from launch.launch_description_sources import PythonLaunchDescriptionSource\n"
        "given = dict(word.split(':=', 1) for word in sys.argv[2:])\n"
        "included = IncludeLaunchDescription(\n"
        "    PythonLaunchDescriptionSource(sys.argv[1]), launch_arguments=given.items())\n"
        "service = LaunchService(); service.include_launch_description(LaunchDescription([included]))\n"
        "raise SystemExit(service.run())\n"
    )
    out = tmp_path / "launched"
    words = [f"scene:={MACHINE}", f"out:={out}", f"overrides:={SHORT}", "namespace:=field"]
    done = subprocess.run([sys.executable, "-c", source, str(FILE), *words], timeout=LIMIT_S, check=False)
    assert done.returncode == 0
    direct = ["run", str(MACHINE), "--mode", "direct", "--out", str(tmp_path / "direct"), "--set", SHORT]
    assert main(direct) == 0
    assert main(["report", str(out)]) == 0
    assert (out / "series.csv").read_bytes() == (tmp_path / "direct/series.csv").read_bytes()
    assert load_scene(out / "scene.yaml").scene.duration_s == 0.05
