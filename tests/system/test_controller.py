"""A controller in the lockstep: the same bits in every way, and named faults when it misbehaves."""

import json
import math
import os
import re
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from subsoil_ros.api.run_frame import simulate
from subsoil_ros.coupling.control import Controller, build_controller
from subsoil_ros.coupling.exit_status import ExitStatus
from subsoil_ros.coupling.observer import RunWatch
from subsoil_ros.coupling.protocol import CONTROLLER
from subsoil_ros.coupling.run_settings import RunSettings
from subsoil_ros.errors import InterruptedRunError, RunError
from subsoil_ros.loading.loader import ResolvedScene, load_scene
from subsoil_ros.messages import DriverCommand, MechanismState
from subsoil_ros.recording.checkpoint import newest_valid
from subsoil_ros.recording.topics import LATCHED, bag_topic
from subsoil_ros.ros.nodes.composed import run_composed, scene_builds
from subsoil_ros.ros.nodes.controller_node import ControllerNode
from tests.system.conftest import SCENE, Run, is_alive, messages
from tests.system.test_nodes import (
    LIMIT_S,
    _own_domain,  # noqa: F401 (a fixture)
    contents,
)

TICKS, EVERY = 300, 20
LATCHED_IN_BAG = {bag_topic(topic) for topic in LATCHED}  # each bag begins with them
CONTROL = {
    "driver": "H10_drive", "interval_ticks": EVERY, "lowest_speed": 0.1, "highest_speed": 0.6,
    "max_acceleration": 2.0,
    "law": {"kind": "draft_limit", "draft_limit_newton": 100.0, "gain_per_kg": 0.002},
}  # fmt: skip
CHANGES = [
    f"controller={json.dumps(CONTROL)}", f"duration_s={TICKS * 5e-4}", 
    "coupling.communication_step_ns=500000", "record.series_ticks=10",
]  # fmt: skip


@pytest.fixture(scope="module")
def scene() -> ResolvedScene:
    """The machine without soil, its trolley under a controller."""
    return load_scene(SCENE.parent / "mechanism_only.yaml", CHANGES)


def run_nodes(
    scene: ResolvedScene, bag: Path, controller: Callable[[], Controller] | None = None
) -> ExitStatus:
    """All nodes in this process; `controller` makes another one than the scene's."""
    run = RunSettings(scene, "test", bag=bag)
    builds = scene_builds(run)
    if controller is not None:
        builds[CONTROLLER] = lambda run, heartbeat, context: ControllerNode(
            controller(), run, heartbeat, context
        )
    return run_composed(run, builds)


def run_without_ros(scene: ResolvedScene, bag: Path, controller: Controller | None) -> None:
    """The same by the direct run."""
    simulate(RunSettings(scene, "test", bag=bag), controller=controller)


def command_ticks(bag: Path, communication_step_ns: int) -> list[int]:
    """Ticks of the commands in a bag."""
    return [
        time_ns // communication_step_ns - 1
        for topic, time_ns, _ in messages(bag)
        if topic.endswith("driver_command")
    ]


@pytest.mark.parametrize("law", ["draft_limit", "external"])
def test_nodes_and_direct_run_drive_alike(scene: ResolvedScene, tmp_path: Path, law: str) -> None:
    """Bags are equal message for message, with a command at every control tick; whoever runs the node."""
    others = None
    if law == "external":
        assert scene.scene.controller is not None
        own = partial(build_controller, scene)
        scene = load_scene(
            SCENE.parent / "mechanism_only.yaml", [*CHANGES, "controller.law={kind: external}"]
        )
        assert build_controller(scene) is None
        others = own
    assert run_nodes(scene, tmp_path / "nodes", others) == ExitStatus()
    run_without_ros(scene, tmp_path / "direct", others() if others else build_controller(scene))
    assert contents(tmp_path / "nodes") == contents(tmp_path / "direct")
    assert command_ticks(tmp_path / "nodes", scene.timing.communication_step_ns) == list(
        range(EVERY, TICKS, EVERY)
    )


@pytest.mark.parametrize("stopped", [6 * EVERY - 1, 6 * EVERY + 3], ids=["before a command", "between two"])
def test_a_resumed_run_is_driven_on_alike(scene: ResolvedScene, tmp_path: Path, stopped: int) -> None:
    """From a checkpoint, in both ways: the messages of a run that was never stopped."""
    run_without_ros(scene, tmp_path / "whole", build_controller(scene))
    watch = RunWatch(lambda tick: watch.signals.append(signal.SIGTERM) if tick == stopped else None)
    with pytest.raises(InterruptedRunError):
        simulate(RunSettings(scene, "test", checkpoints=tmp_path / "checkpoints"), observer=watch)
    resumed, _ = newest_valid(tmp_path / "checkpoints")
    assert resumed is not None
    assert resumed.tick == stopped
    run = RunSettings(scene, "test", bag=tmp_path / "nodes", resumed=resumed)
    status = run_composed(run, scene_builds(run))
    assert status == ExitStatus()
    simulate(RunSettings(scene, "test", bag=tmp_path / "direct", resumed=resumed))
    expected = [item for item in contents(tmp_path / "whole") if item[1] > (stopped + 1) * 500_000]
    direct, nodes = contents(tmp_path / "direct"), contents(tmp_path / "nodes")
    assert nodes == direct
    assert [item for item in direct if item[0] not in LATCHED_IN_BAG] == expected


class Nowhere:
    """Takes the records of a run and forgets them."""

    def write(self, record: object) -> None:
        """Takes one."""


class Faulty:
    """The scene's controller, until a tick at which `spoil` changes its command."""

    def __init__(
        self, scene: ResolvedScene, spoil: Callable[[DriverCommand], DriverCommand], tick: int = 5 * EVERY
    ) -> None:
        self._good = build_controller(scene)
        self._spoil = spoil
        self._tick = tick

    def command(self, tick: int, state: MechanismState) -> DriverCommand:
        assert self._good is not None
        command = self._good.command(tick, state)
        return self._spoil(command) if tick == self._tick else command


def die(command: DriverCommand) -> DriverCommand:
    """A controller's own fault."""
    raise RunError("the battery is empty")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda command: replace(command, speed=math.nan), "tick 100: driver_command: speed nan"),
        (lambda command: replace(command, speed=0.6), "tick 100: driver_command: speed 0.6 .* is a jump"),
        (lambda command: replace(command, tick=120), "driver_command: tick 120 came where tick 100 is due"),
        (lambda command: replace(command, tick=80), "driver_command: tick 80 came where tick 100 is due"),
        (lambda command: replace(command, run_id="other"), "tick 100 is of run 'other', this is run 'test'"),
        (die, "controller: the battery is empty"),
    ],
    ids=["nan", "jump", "later", "earlier", "foreign", "dies"],
)
def test_a_controller_that_misbehaves_ends_the_run(
    scene: ResolvedScene, tmp_path: Path, spoil: Callable[[DriverCommand], DriverCommand], words: str
) -> None:
    """NaN, a jump, another tick or run, a fault of its own: exit 3 by name, the record goes no further."""
    status = run_nodes(scene, tmp_path / "bag", lambda: Faulty(scene, spoil))
    assert status.code == 3
    assert re.search(words, status.reason), status.reason
    recorded = command_ticks(tmp_path / "bag", scene.timing.communication_step_ns)
    assert recorded == list(range(EVERY, 5 * EVERY, EVERY))[: len(recorded)]


@pytest.mark.full
def test_separate_processes_drive_as_one(tmp_path: Path) -> None:
    """The controller as a process of its own: the series of the direct run, byte for byte."""
    series = []
    for mode in ("direct", "nodes"):
        changes = [item for change in (CHANGES[0], *CHANGES[2:]) for item in ("--set", change)]
        scene = SCENE.parent / "mechanism_only.yaml"
        run = Run(tmp_path / mode, mode, TICKS * 5e-4, *changes, scene=scene)
        status, _, err = run.finish()
        assert status == 0, err
        series.append((run.out / "series.csv").read_bytes())
    assert series[0] == series[1]


@pytest.mark.full
def test_a_killed_controller_ends_the_run(tmp_path: Path) -> None:
    """kill -9 of the controller's process: exit 3, it is named, nothing is left running."""
    changes = [item for change in CHANGES[::2] + CHANGES[3:] for item in ("--set", change)]
    run = Run(tmp_path / "out", "nodes", 600.0, *changes, scene=SCENE.parent / "mechanism_only.yaml")
    pids: dict[str, int] = {}
    try:
        run.wait_until_recording()
        pids = run.node_pids()
        os.kill(pids["controller"], signal.SIGKILL)
        status, _, err = run.finish()
        assert status == 3, err
        assert "controller node (process" in err.strip().splitlines()[-1]
        assert not any(is_alive(pid) for pid in pids.values())
    finally:
        run.end(pids)


def test_others_with_use_sim_time_follow_the_ticks(scene: ResolvedScene, tmp_path: Path) -> None:
    """A foreign node with use_sim_time: its clock goes up tick by tick to the end of the run."""
    context = Context()
    rclpy.init(context=context)
    node = Node("follower", context=context, parameter_overrides=[Parameter("use_sim_time", value=True)])
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    times: list[int] = []
    statuses: list[ExitStatus] = []
    runner = threading.Thread(target=lambda: statuses.append(run_nodes(scene, tmp_path / "bag")))
    try:
        runner.start()
        last_ns = TICKS * scene.timing.communication_step_ns
        deadline = time.monotonic() + LIMIT_S
        while times[-1:] != [last_ns] and statuses in ([], [ExitStatus()]) and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.02)
            now = node.get_clock().now().nanoseconds
            if times[-1:] != [now]:
                times.append(now)
        runner.join()
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert statuses == [ExitStatus()]
    assert times == sorted(times)
    assert times[-1] == last_ns
    assert all(now % scene.timing.communication_step_ns == 0 for now in times)
