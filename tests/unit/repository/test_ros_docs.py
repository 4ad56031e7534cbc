"""What is written for ROS developers is what there is."""

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

import yaml

import subsoil_ros
from subsoil_ros.coupling.run_options import OPTIONS
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.messages import Grant, ToolMotions, ToolWrenches
from subsoil_ros.recording.topics import LATCHED, TOPIC_OF, batch_topic, derived_topics
from subsoil_ros.recording.types import BATCH

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")
ROS_PACKAGES = {
    "ament_index_python",
    "launch",
    "launch_ros",
    "rcl_interfaces",
    "rclpy",
    "simulation_interfaces",
}


def rows(heading: str) -> list[list[str]]:
    """Cells of the table rows of a section."""
    section = TEXT.split(f"## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_every_topic_is_in_the_table_with_its_type() -> None:
    """Those of the records, those derived from them, the latched ones, and /diagnostics; no other."""
    scene = load_scene(ROOT / "config/scenes/tine.yaml").scene
    derived = derived_topics(scene).items()
    others = {topic.replace("tool/tine/", "tool/NAME/"): kind for topic, kind in derived}
    others |= {batch_topic(kind): BATCH for kind in (Grant, ToolMotions, ToolWrenches)}
    others |= LATCHED | {"/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"}
    listed = {cells[0].strip("`"): cells[1] for cells in rows("Topics")}
    assert set(listed) == {*TOPIC_OF.values(), *others}
    for topic, kind in others.items():
        assert listed[topic] == kind.replace("/msg/", "/")


def test_every_service_and_action_is_in_the_table() -> None:
    """As run_services.py serves them, each with a type that subsoil_msgs has."""
    source = (ROOT / "subsoil_ros/ros/nodes/run_services.py").read_text(encoding="utf-8")
    served = dict(re.findall(r'_serve\("(\w+)", "(\w+)"', source)) | {"SimulateSteps": "simulate_steps"}
    listed = {cells[0].strip("`"): cells[1].split()[0] for cells in rows("Services and the action")}
    assert {name: kind for kind, name in served.items()}.items() <= listed.items()
    folders = [ROOT / "msg_defs" / folder for folder in ("srv", "action")]
    assert set(served) <= {path.stem for folder in folders for path in folder.iterdir()}


def test_every_parameter_is_in_the_table() -> None:
    """Of the nodes' processes."""
    source = (ROOT / "subsoil_ros/ros/process/parameters.py").read_text(encoding="utf-8")
    declared = re.findall(r'^    "(\w+)": ParameterKey\(', source.split("PARAMETERS: ")[1], re.MULTILINE)
    listed = {name for cells in rows("Parameters") for name in re.findall(r"`(\w+)`", cells[0])}
    assert listed == {*declared, *OPTIONS}


def test_the_citation_is_of_this_version() -> None:
    """CITATION.cff has the keys that its schema (1.2.0) asks for, and the version of the package."""
    document = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(document)
    assert document["version"] == subsoil_ros.__version__
    assert document["license"] == "Apache-2.0"


def imported_ros_packages(folder: str) -> set[str]:
    """ROS packages that Python files import, or name as a message type in a text."""
    found: set[str] = set()
    for path in (ROOT / folder).rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
        found |= set(re.findall(r'"(\w+)/msg/\w+"', text))
    return {name for name in found if name.endswith(("_msgs", "_srvs")) or name in ROS_PACKAGES}


def test_package_xml_names_what_is_imported() -> None:
    """Of nodes, recording, launch file and example at run time; of the tests at test time."""
    tree = ElementTree.parse(ROOT / "package.xml")
    at_run_time = {item.text for item in tree.iter("exec_depend")}
    at_test_time = at_run_time | {item.text for item in tree.iter("test_depend")}
    used = set().union(*map(imported_ros_packages, ("subsoil_ros/ros", "launch", "examples")))
    assert {"rclpy", "tf2_msgs", "rcl_interfaces", "launch_ros", "ament_index_python"} <= used
    assert used <= at_run_time
    assert imported_ros_packages("tests/ros") - {"subsoil_msgs", "simulation_interfaces"} <= at_test_time
