"""The layouts for Foxglove fit real bags, and have the form that Foxglove reads."""

import dataclasses
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rosbags.highlevel import AnyReader

from subsoil_ros.cli.main import main

ROOT = Path(__file__).parents[2]
LAYOUT = ROOT / "config/foxglove/subsoil.json"
DIGGING = ROOT / "config/foxglove/digging.json"
DRAG = ("external=false", "start_z_m=0", "speed_x_m_per_s={kind: constant, value: -0.3}")
TOPIC = re.compile(r"/\w+(/\w+)*")
STEP = re.compile(r"\.(?P<field>\w+)|(?P<all>\[:\])|\{(?P<key>\w+)==\$(?P<variable>\w+)\}")


@pytest.fixture(scope="module")
def layout() -> dict[str, Any]:
    """The layout as written."""
    document: dict[str, Any] = json.loads(LAYOUT.read_text())
    return document


@pytest.fixture(scope="module")
def digging() -> dict[str, Any]:
    """The layout for digging as written."""
    document: dict[str, Any] = json.loads(DIGGING.read_text())
    return document


@pytest.fixture(scope="module")
def dig_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bag of a bucket that a path moves through a terrain."""
    out = tmp_path_factory.mktemp("dig") / "out"
    changes = ("duration_s=0.1", *(f"tools.bucket.path.{change}" for change in DRAG))
    words = [word for change in changes for word in ("--set", change)]
    scene = str(ROOT / "examples/bucket_arm/terrain.yaml")
    assert main(["run", scene, "--mode", "direct", "--out", str(out), *words]) == 0
    return out / "bag"


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


def assert_that_plots_are_full(layout: dict[str, Any], bag: Path) -> None:
    """Every path gives one number in every message of its topic."""
    with AnyReader([bag]) as reader:
        for path in plotted_paths(layout):
            topic = TOPIC.match(path).group()
            connections = [item for item in reader.connections if item.topic == topic]
            assert connections, f"{path}: the bag has no such topic"
            found = [
                resolve(path, reader.deserialize(data, connection.msgtype), layout["globalVariables"])
                for connection, _, data in reader.messages(connections)
            ]
            assert found
            assert all(len(values) == 1 and isinstance(values[0], float) for values in found), path


def test_every_path_gives_one_number_in_every_message(layout: dict[str, Any], machine_bag: Path) -> None:
    """Topics, fields and names of bodies and forces are those of a bag of ours; no plot stays empty."""
    assert len(plotted_paths(layout)) == 5
    assert_that_plots_are_full(layout, machine_bag)


def test_the_layout_for_digging_fits_a_dig(digging: dict[str, Any], dig_bag: Path) -> None:
    """Plots are full, each panel has its place, and the ground has the field that colours it."""
    assert len(plotted_paths(digging)) == 7
    assert_that_plots_are_full(digging, dig_bag)
    assert sorted(leaves(digging["layout"])) == sorted(digging["configById"])
    (scene,) = panels(digging, "3D")
    with AnyReader([dig_bag]) as reader:
        by_topic = {item.topic: item for item in reader.connections}
        for topic in ("/subsoil/soil/height_map", "/subsoil/soil/points"):
            *_, (connection, _, data) = reader.messages([by_topic[topic]])
            fields = [field.name for field in reader.deserialize(data, connection.msgtype).fields]
            assert scene["topics"][topic]["colorField"] in fields
    assert set(scene["topics"]) <= set(by_topic)


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


@pytest.mark.parametrize("file", [LAYOUT, DIGGING], ids=lambda file: file.stem)
def test_every_setting_is_one_that_foxglove_knows(file: Path) -> None:
    """Held against the panel types of foxglove-sdk, which are generated from the application's own."""
    layouts = pytest.importorskip("foxglove.layouts", reason="foxglove-sdk has no layouts")
    layout = json.loads(file.read_text())
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
    for topic, settings in scene["topics"].items():
        markers = topic == "/subsoil/tool_markers"
        assert set(settings) <= keys_of(
            layouts.BaseRendererRosMarkerTopicSettings
            if markers
            else layouts.BaseRendererPointCloudTopicSettings
        )
    for layer in scene["layers"].values():
        grid = layer["layerId"] == "foxglove.Grid"
        assert set(layer) <= keys_of(
            layouts.BaseRendererGridLayerSettings if grid else layouts.BaseRendererUrdfLayerSettings
        )
