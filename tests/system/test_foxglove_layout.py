"""The layout for Foxglove fits a real bag, and has the form that Foxglove reads."""

import dataclasses
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rosbags.highlevel import AnyReader

LAYOUT = Path(__file__).parents[2] / "config/foxglove/subsoil.json"
TOPIC = re.compile(r"/\w+(/\w+)*")
STEP = re.compile(r"\.(?P<field>\w+)|(?P<all>\[:\])|\{(?P<key>\w+)==\$(?P<variable>\w+)\}")


@pytest.fixture(scope="module")
def layout() -> dict[str, Any]:
    """The layout as written."""
    document: dict[str, Any] = json.loads(LAYOUT.read_text())
    return document


def panels(layout: dict[str, Any], kind: str) -> Iterator[dict[str, Any]]:
    """Configurations of the panels of one kind."""
    for name, config in layout["configById"].items():
        if name.partition("!")[0] == kind:
            yield config


def plotted_paths(layout: dict[str, Any]) -> list[str]:
    """Message paths of all plots."""
    return [path["value"] for panel in panels(layout, "Plot") for path in panel["paths"]]


def resolve(path: str, message: Any, variables: dict[str, Any]) -> list[Any]:
    """The values that a message path gives on a message; an error where the schema has no such field."""
    at = TOPIC.match(path).end()
    values, spread = [message], False
    while at < len(path):
        step = STEP.match(path, at)
        assert step is not None, f"{path}: cannot be read from {path[at:]!r} on"
        at = step.end()
        if step["field"]:
            values = [getattr(value, step["field"]) for value in values]
        elif step["all"]:
            values, spread = [item for value in values for item in value], True
        else:
            assert spread, f"{path}: a filter needs the elements of an array"
            values = [value for value in values if getattr(value, step["key"]) == variables[step["variable"]]]
    return values


def test_every_path_gives_one_number_in_every_message(layout: dict[str, Any], machine_bag: Path) -> None:
    """Topics, fields and names of bodies and forces are those of a bag of ours; no plot stays empty."""
    paths = plotted_paths(layout)
    assert len(paths) == 5
    with AnyReader([machine_bag]) as reader:
        for path in paths:
            topic = TOPIC.match(path).group()
            connections = [item for item in reader.connections if item.topic == topic]
            assert connections, f"{path}: the bag has no such topic"
            found = [
                resolve(path, reader.deserialize(data, connection.msgtype), layout["globalVariables"])
                for connection, _, data in reader.messages(connections)
            ]
            assert found
            assert all(len(values) == 1 and isinstance(values[0], float) for values in found), path


def test_the_plots_are_the_ones_people_ask_for(layout: dict[str, Any]) -> None:
    """Draft, spring force, angle, height, energy residual, in this order from the top."""
    assert [path.rpartition(".")[2] for path in plotted_paths(layout)] == [
        "draft_newton", "load", "angle_rad", "z_m", "residual_ratio",
    ]  # fmt: skip


def test_the_scene_shows_soil_by_speed_and_the_machine(layout: dict[str, Any], machine_bag: Path) -> None:
    """Topics are in the bag, the colour field is in the cloud, frames of the markers are moved by /tf."""
    (scene,) = panels(layout, "3D")
    with AnyReader([machine_bag]) as reader:
        by_topic = {item.topic: item for item in reader.connections}
        assert set(scene["topics"]) <= set(by_topic)
        last = {
            connection.topic: reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages([by_topic[name] for name in (*scene["topics"], "/tf")])
        }
    cloud = last["/subsoil/soil/points"]
    assert cloud.width > 0
    assert cloud.header.frame_id == scene["followTf"] == scene["layers"]["surface"]["frameId"]
    assert scene["topics"]["/subsoil/soil/points"]["colorField"] in [field.name for field in cloud.fields]
    frames = {item.child_frame_id for item in last["/tf"].transforms}
    markers = last["/subsoil/tool_markers"].markers
    assert markers
    assert {marker.header.frame_id for marker in markers} <= frames


def test_the_machine_is_a_urdf_that_tf_moves(layout: dict[str, Any], machine_bag: Path) -> None:
    """The layer's topic is a URDF, and a frame of /tf stands for each of its links but the root."""
    (scene,) = panels(layout, "3D")
    machine = scene["layers"]["machine"]
    assert (machine["layerId"], machine["sourceType"]) == ("foxglove.Urdf", "topic")
    assert (machine["controlMode"], machine["framePrefix"]) == ("transforms", "")
    with AnyReader([machine_bag]) as reader:
        wanted = [item for item in reader.connections if item.topic in (machine["topic"], "/tf")]
        last = {
            connection.topic: reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages(wanted)
        }
    robot = ElementTree.fromstring(last[machine["topic"]].data)
    frames = {item.child_frame_id for item in last["/tf"].transforms}
    assert robot.tag == "robot"
    assert {link.get("name") for link in robot.findall("link")} == frames | {scene["followTf"]}


def leaves(tree: dict[str, Any] | str) -> Iterator[str]:
    """Panels of the tree of splits."""
    if isinstance(tree, str):
        yield tree
        return
    assert tree["direction"] in ("row", "column")
    assert 0 < tree["splitPercentage"] < 100
    yield from leaves(tree["first"])
    yield from leaves(tree["second"])


def test_every_panel_has_its_place(layout: dict[str, Any]) -> None:
    """The tree of splits names each panel once."""
    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])


def keys_of(kind: type) -> set[str]:
    """Names, as Foxglove writes them, of what the SDK lets be configured."""
    return {re.sub(r"_(\w)", lambda found: found[1].upper(), item.name) for item in dataclasses.fields(kind)}


def test_every_setting_is_one_that_foxglove_knows(layout: dict[str, Any]) -> None:
    """Held against the panel types of foxglove-sdk, which are generated from the application's own."""
    layouts = pytest.importorskip("foxglove.layouts", reason="foxglove-sdk has no layouts")
    title = {
        "foxglovePanelTitle"
    }  # in a layout file beside the settings, in the SDK an attribute of the panel
    for panel in panels(layout, "Plot"):
        assert set(panel) - title <= keys_of(layouts.PlotConfig)
        for path in panel["paths"]:
            assert set(path) <= keys_of(layouts.PlotSeries)
    (scene,) = panels(layout, "3D")
    assert set(scene) - title <= keys_of(layouts.ThreeDeeConfig)
    assert set(scene["cameraState"]) <= keys_of(layouts.ThreeDeeCameraState)
    assert set(scene["scene"]["transforms"]) <= keys_of(layouts.BaseRendererTransforms)
    topics = scene["topics"]
    assert set(topics["/subsoil/soil/points"]) <= keys_of(layouts.BaseRendererPointCloudTopicSettings)
    assert set(topics["/subsoil/tool_markers"]) <= keys_of(layouts.BaseRendererRosMarkerTopicSettings)
    assert set(scene["layers"]["surface"]) <= keys_of(layouts.BaseRendererGridLayerSettings)
    assert set(scene["layers"]["machine"]) <= keys_of(layouts.BaseRendererUrdfLayerSettings)
