"""What is written for ROS developers is what there is."""

import re
from pathlib import Path

import yaml

import subsoil_ros
from subsoil_ros.recording.topics import LATCHED, TOPIC_OF, derived_topics
from subsoil_ros.scene.loader import load_scene

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "ros.md").read_text(encoding="utf-8")


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
    others |= LATCHED | {"/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"}
    listed = {cells[0].strip("`"): cells[1] for cells in rows("Topics")}
    assert set(listed) == {*TOPIC_OF.values(), *others}
    for topic, kind in others.items():
        assert listed[topic] == kind.replace("/msg/", "/")


def test_every_service_and_action_is_in_the_table() -> None:
    """As simulation_services.py serves them, each with a type that subsoil_msgs has."""
    source = (ROOT / "subsoil_ros/nodes/simulation_services.py").read_text(encoding="utf-8")
    served = dict(re.findall(r'_serve\("(\w+)", "(\w+)"', source)) | {"SimulateSteps": "simulate_steps"}
    listed = {cells[0].strip("`"): cells[1].split()[0] for cells in rows("Services and the action")}
    assert {name: kind for kind, name in served.items()}.items() <= listed.items()
    folders = [ROOT / "msg_defs" / folder for folder in ("srv", "action")]
    assert set(served) <= {path.stem for folder in folders for path in folder.iterdir()}


def test_every_parameter_is_in_the_table() -> None:
    """Of the nodes' processes."""
    source = (ROOT / "subsoil_ros/nodes/process.py").read_text(encoding="utf-8")
    declared = re.findall(r'^    "(\w+)": \(', source.split("PARAMETERS: ")[1], re.MULTILINE)
    listed = {name for cells in rows("Parameters") for name in re.findall(r"`(\w+)`", cells[0])}
    assert listed == set(declared)


def test_the_citation_is_of_this_version() -> None:
    """CITATION.cff has the keys that its schema (1.2.0) asks for, and the version of the package."""
    document = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= set(document)
    assert document["version"] == subsoil_ros.__version__
    assert document["license"] == "Apache-2.0"
