"""Which processes a run starts, and with what."""

from pathlib import Path

import pytest

from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.errors import InputError
from subsoil_ros.loading.loader import load_scene
from subsoil_ros.ros.process.node_plan import (
    NodeStart,
    checked_namespace,
    nodes_of,
    remappings,
    ros_arguments,
)

SCENES = Path(__file__).parents[3] / "config" / "scenes"
EXTERNAL = "controller.law={kind: external}"


def nodes_to_start(
    name: str, tmp_path: Path, *overrides: str, recorded: bool = True
) -> tuple[NodeStart, ...]:
    """The nodes of a shipped scene."""
    resolved = load_scene(SCENES / f"{name}.yaml", overrides)
    settings = RunSettings(resolved, "7", bag=tmp_path / "bag", threads=3, paused=True, recorded=recorded)
    return nodes_of(settings, tmp_path / "scene.yaml")


@pytest.mark.parametrize(
    ("name", "overrides", "expected"),
    [
        ("subsoiler_1s300_quick", (), ["mechanism", "soil", "recorder", "coupler"]),
        ("mechanism_only", (), ["mechanism", "recorder", "coupler"]),
        ("tine", (), ["soil", "recorder", "coupler"]),
        ("subsoiler_1s300_draft_limit", (), ["mechanism", "soil", "controller", "recorder", "coupler"]),
        ("subsoiler_1s300_draft_limit", (EXTERNAL,), ["mechanism", "soil", "recorder", "coupler"]),
    ],
)
def test_only_what_a_scene_names_is_started(
    tmp_path: Path, name: str, overrides: tuple[str, ...], expected: list[str]
) -> None:
    """No process for a part that is absent, none for a controller from outside."""
    assert [node.name for node in nodes_to_start(name, tmp_path, *overrides)] == expected


def test_every_node_is_told_the_same_of_the_run(tmp_path: Path) -> None:
    """Scene, run and record are common; threads, bag and pause go to who needs them."""
    nodes = {node.name: node.parameters for node in nodes_to_start("subsoiler_1s300_quick", tmp_path)}
    for key in ("scene", "run_id", "recorded", "supervised", "checkpoints", "resume"):
        assert len({repr(parameters[key]) for parameters in nodes.values()}) == 1
    assert {name for name, parameters in nodes.items() if "threads" in parameters} == {"soil"}
    assert {name for name, parameters in nodes.items() if "bag" in parameters} == {"recorder"}
    assert nodes["coupler"]["paused"] is True


def test_a_run_may_do_without_a_recorder(tmp_path: Path) -> None:
    """Then no node records, and every node is told so."""
    nodes = nodes_to_start("mechanism_only", tmp_path, recorded=False)
    assert [node.name for node in nodes] == ["mechanism", "coupler"]
    assert all(node.parameters["recorded"] is False for node in nodes)


def test_words_for_a_node() -> None:
    """Texts stay texts for rcl's YAML; in a namespace the absolute topics come along."""
    words = ros_arguments({"run_id": "7", "threads": 2, "paused": True, "resume": ""}, "/left")
    assert words[0] == "--ros-args"
    assert [words[k + 1] for k, word in enumerate(words) if word == "-p"] == [
        'run_id:="7"', "threads:=2", "paused:=true", 'resume:=""'
    ]  # fmt: skip
    assert [words[k + 1] for k, word in enumerate(words) if word == "-r"] == [
        "__ns:=/left", "/clock:=clock", "/tf:=tf"
    ]  # fmt: skip
    assert remappings("") == ()
    assert "-r" not in ros_arguments({}, "")


@pytest.mark.parametrize(
    ("given", "expected"), [("", ""), ("/", ""), ("left", "/left"), ("/field/left_2", "/field/left_2")]
)
def test_namespaces(given: str, expected: str) -> None:
    """With or without the first slash."""
    assert checked_namespace(given) == expected


@pytest.mark.parametrize("given", ["2nd", "a b", "a//b", "a/", "a-b"])
def test_what_is_no_namespace_is_refused(given: str) -> None:
    """One message, with what is allowed."""
    with pytest.raises(InputError, match=r"namespace: given '.*'; it must be names of letters"):
        checked_namespace(given)
