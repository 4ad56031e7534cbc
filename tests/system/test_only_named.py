"""Processes and topics of a run are those that its scene names, and without a bag nothing is recorded."""

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from tests.system.conftest import LIMIT_S, Run

SCENES = Path(__file__).parents[2] / "config" / "scenes"
STEPS = {f"/simulate_steps/_action/{part}" for part in ("status", "feedback")}
ALWAYS = {"/node_status", "/coupling_report", "/clock", "/diagnostics", *STEPS}
ALWAYS |= {"/grant", "/grant_batch", "/tool_motions", "/tool_motions_batch"}
OF_ROS = {"/rosout", "/parameter_events"}
RECORDER = {"/tick_ack"}
MECHANISM = {"/mechanism_state", "/robot_description"}
SOIL = {"/tool_wrenches", "/tool_wrenches_batch", "/soil_state"}
TINE = {"/tool/tine/pose", "/tool/tine/wrench", "/tool_markers", "/robot_description"}
MACHINE = {"/tool/shank/pose", "/tool/shank/wrench", "/tool_markers"}
WHEELS = {f"/tool/wheel_{side}/{what}" for side in ("left", "right") for what in ("pose", "wrench")}
SMALL = ["soil.bin.length_m=0.1", "soil.bin.width_m=0.1", "soil.bin.depth_m=0.06"]


@pytest.fixture
def runs() -> Iterator[list[Run]]:
    """Runs to be ended, whatever the test found."""
    started: list[Run] = []
    yield started
    for run in started:
        run.end(run.node_pids())


def look(domain: int, expected: set[str]) -> set[str]:
    """Topics of a domain once the expected ones are there, and a second later."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node("onlooker", context=context)

    def topics() -> set[str]:
        return {name for name, _ in node.get_topic_names_and_types()} - OF_ROS

    deadline = time.monotonic() + LIMIT_S
    while not expected <= topics() and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(1.0)
    found = topics()
    node.destroy_node()
    rclpy.shutdown(context=context)
    return found


@pytest.mark.full
@pytest.mark.parametrize(
    ("scene", "overrides", "nodes", "topics"),
    [
        ("mechanism_only.yaml", [], {"mechanism", "recorder"}, ALWAYS | MECHANISM | RECORDER),
        ("mechanism_only.yaml", ["record.bag=false"], {"mechanism"}, ALWAYS | MECHANISM),
        ("tine.yaml", SMALL, {"soil", "recorder"}, ALWAYS | SOIL | TINE | RECORDER | {"/soil/points"}),
        ("tine.yaml", [*SMALL, "record.cloud_hz=0"], {"soil", "recorder"}, ALWAYS | SOIL | TINE | RECORDER),
        (
            "subsoiler_1s300_wedge.yaml",
            [],
            {"mechanism", "soil", "recorder"},
            ALWAYS | MECHANISM | SOIL | MACHINE | WHEELS | RECORDER,
        ),
        (
            "subsoiler_1s300_draft_limit.yaml",
            [],
            {"mechanism", "soil", "controller", "recorder"},
            ALWAYS | MECHANISM | SOIL | MACHINE | RECORDER | {"/soil/points", "/driver_command"},
        ),
    ],
)
def test_processes_and_topics(
    tmp_path: Path,
    runs: list[Run],
    monkeypatch: pytest.MonkeyPatch,
    scene: str,
    overrides: list[str],
    nodes: set[str],
    topics: set[str],
) -> None:
    """As an onlooker sees them while the run waits for its first tick."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    sets = [part for change in overrides for part in ("--set", change)]
    run = Run(tmp_path / "out", "nodes", 1.0, *sets, "--paused", scene=SCENES / scene)
    runs.append(run)
    assert run.process.stdout is not None
    said = next(line for line in run.process.stdout if "ROS_DOMAIN_ID=" in line)
    domain = int(said.split("ROS_DOMAIN_ID=")[1].split()[0])
    assert look(domain, topics) == topics
    assert set(run.node_pids()) == nodes | {"coupler"}


@pytest.mark.full
def test_without_a_bag_every_mode_gives_the_same_state(tmp_path: Path) -> None:
    """Nothing is recorded; the state at the end is that of a recorded run; a checkpoint is gone on from."""
    scene, digests = SCENES / "mechanism_only.yaml", []
    for mode, bag in (("direct", "true"), ("direct", "false"), ("composed", "false"), ("nodes", "false")):
        out = tmp_path / f"{mode}_{bag}"
        sets = ["--set", f"record.bag={bag}", "--set", "record.checkpoint_s=0.06"]
        status, said, err = Run(out, mode, 0.1, *sets, scene=scene).finish()
        assert status == 0, err
        assert "[INFO]" not in said + err  # what nodes log stands in log/ and on /rosout
        assert bool(re.search(r"^nodes in ROS_DOMAIN_ID=\d+$", err, re.MULTILINE)) == (mode != "direct")
        assert (out / "bag").exists() == (out / "series.csv").exists() == (bag == "true")
        digests.append(json.loads((out / "summary.json").read_text())["run"]["state_sha256"])
    assert digests[1:] == digests[:1] * 3
    resumed = Run(
        tmp_path / "resumed", "nodes", 0.1, *sets, "--resume", str(tmp_path / "nodes_false"), scene=scene
    )
    status, _, err = resumed.finish()
    assert status == 0, err
    summary = json.loads((tmp_path / "resumed" / "summary.json").read_text())["run"]
    assert summary["state_sha256"] == digests[0]
    assert summary["recorded"] is False
    assert summary["resumed_from"]["tick"] > 0
