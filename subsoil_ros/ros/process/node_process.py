"""A node as an operating-system process: parameters, signals, supervision, exit status."""

import json
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ...coupling.exit_status import KEEP_S, SIGNAL_STATUS, ExitStatus, interrupted
from ...coupling.protocol import COUPLER, RECORDER
from ...coupling.signals import caught_signals
from ...errors import InputError, RunError
from ...loading.loader import ResolvedScene, load_scene
from ...recording.checkpoint import read_checkpoint
from ..nodes.lockstep_node import LAST_WORD_S, OWN_TIME, LockstepNode, one_line
from ..transport.shared_memory import avoid_full_memory
from .heartbeat import LATE_S, Heartbeat, NodeRun
from .node_thread import Service

GRACE_S = 2.0
"""Time for a node that computes to come back and end in order; then the process ends itself."""


@dataclass(frozen=True)
class NodeSettings:
    """Parameters of a node's process, all read-only."""

    scene: str
    run_id: str
    threads: int
    bag: str
    recorded: bool
    supervised: bool
    paused: bool = False
    checkpoints: str = ""
    resume: str = ""
    live: int = 0

    def node_run(self, resolved: ResolvedScene) -> NodeRun:
        """What all nodes of the run share.

        Raises:
            InputError: the checkpoint to go on from cannot be used.
        """
        return NodeRun(
            self.run_id,
            resolved,
            Path(self.checkpoints) if self.checkpoints else None,
            read_checkpoint(Path(self.resume), resolved.scene_hash) if self.resume else None,
            self.recorded,
        )


MOST_NODES = 5
"""Of a run, each a process: it is not known here how many there are."""

_TEXT = "text; a number in quotes is one too: run_id:=\"'7'\""
_FLAG = "true or false"
LARGEST_THREAD_COUNT = 1024
"""Of the parameter's range (chosen: more than any machine has)."""

_RANGES = {"threads": (1, LARGEST_THREAD_COUNT), "live": (0, 65535)}

PARAMETERS: dict[str, tuple[Any, str, str]] = {
    "scene": ("", "scene file, the same for all nodes", "path of a scene file (.yaml)"),
    "run_id": ("run", "name of the run, the same for all nodes; other runs' messages are refused", _TEXT),
    "threads": (
        1,
        "threads of the soil engine; results do not depend on it",
        f"a whole number from 1 to {LARGEST_THREAD_COUNT}",
    ),
    "bag": ("", "folder for the recorder's bag", "path of a folder that does not exist"),
    "checkpoints": (
        "",
        "folder for checkpoints, the same for all nodes; empty: none are written",
        "path of a folder, or empty",
    ),
    "resume": (
        "",
        "checkpoint to go on from, the same for all nodes; empty: from tick 0",
        "path of a checkpoint of this scene, or empty",
    ),
    "live": (
        0,
        "the recorder: port on this machine of a live view for Foxglove; 0: there is none",
        "a whole number from 0 to 65535",
    ),
    "paused": (False, "the coupler: grant no tick before a call of its services resume or step", _FLAG),
    "recorded": (True, "whether the run has a recorder, the same for all nodes", _FLAG),
    "supervised": (False, "end when standard input ends, read stop requests from it", _FLAG),
}
"""Of every node's process: default, description, what is allowed."""


def read_settings(node: Node, name: str) -> NodeSettings:
    """Declares the parameters on `node`, the process of the protocol's node `name`, and reads them.

    Raises:
        InputError: no scene is given, a parameter is not what it may be, or the node was renamed.
    """
    if node.get_name() != f"{name}_process":
        raise InputError(
            f"the node was renamed to '{node.get_name()}'; nodes of a run know each other by "
            "their names, so use a namespace (-r __ns:=/NAME) instead"
        )
    values = {key: _declare(node, key) for key in PARAMETERS}
    if not values["scene"]:
        raise InputError("parameter 'scene' is empty; name a scene, -p scene:=FILE")
    return NodeSettings(**values)


def _declare(node: Node, key: str) -> Any:
    default, description, allowed = PARAMETERS[key]
    descriptor = ParameterDescriptor(description=description, additional_constraints=allowed, read_only=True)
    if key in _RANGES:
        lowest, largest = _RANGES[key]
        descriptor.integer_range = [IntegerRange(from_value=lowest, to_value=largest, step=1)]
    try:
        return node.declare_parameter(key, default, descriptor).value
    except ParameterException as error:
        words = " ".join(str(error).split())
        raise InputError(f"parameter '{key}': needed is {allowed} ({words})") from error


def watched_by(name: str, run: NodeRun) -> tuple[str, ...]:
    """Whose silence ends a node."""
    return run.participants if name == COUPLER else (COUPLER,)


def say(text: str) -> None:
    """Writes a line to standard error, where there may be no room left, or nobody to read it."""
    with suppress(OSError):
        os.write(sys.stderr.fileno(), (text + "\n").encode())  # past the buffer, which would fail at the exit


def report_to_supervisor(**event: Any) -> None:
    """Writes an event to standard output, one JSON object per line."""
    with suppress(BrokenPipeError):  # the supervisor is gone, and standard input says so too
        os.write(sys.stdout.fileno(), (json.dumps(event) + "\n").encode())


def run_process(name: str, build: Callable[..., LockstepNode]) -> int:
    """Runs one node until the run ends. Returns the exit status.

    Args:
        build: makes the node from its NodeSettings, NodeRun and Heartbeat.
    """
    if name in (COUPLER, RECORDER) and hasattr(os, "SCHED_BATCH"):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))  # waking, they push no engine aside
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        words = avoid_full_memory(MOST_NODES)
    except InputError as error:
        words = str(error)
    if words:
        say(f"{name}: {words}")
    try:
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        node = Node(f"{name}_process", parameter_overrides=OWN_TIME)
    except RuntimeError as error:  # rcl's are such; security asked for, say, and not to be had
        say(f"{name}: no ROS node can be made: {' '.join(str(error).split())}")
        return RunError.exit_status
    try:
        settings = read_settings(node, name)
        run = settings.node_run(load_scene(settings.scene))
    except InputError as error:
        say(f"{name}: {one_line(error)}")
        return error.exit_status
    heartbeat = Heartbeat(node, name, run, watched_by(name, run))
    with caught_signals(lambda number: heartbeat.request_stop(interrupted(number))):
        return _serve(name, build, settings, run, heartbeat)


def _serve(
    name: str, build: Callable[..., LockstepNode], settings: NodeSettings, run: NodeRun, heartbeat: Heartbeat
) -> int:
    if settings.supervised:
        threading.Thread(target=_obey, args=(heartbeat,), daemon=True).start()
    heartbeat.start()
    service = Service(name, partial(build, settings, run, heartbeat), heartbeat)
    service.start()
    _wait(service, heartbeat)
    status = service.status
    if status.reason:
        say(f"{name}: {status.reason}")
    if settings.supervised and name == COUPLER:
        report_to_supervisor(exit_status=status.code, reason=status.reason)
    elif name == COUPLER and status.code:
        heartbeat.outlast(LATE_S)  # a node that starts later would wait for this one
    heartbeat.close()
    rclpy.shutdown()
    return status.code


def _obey(heartbeat: Heartbeat) -> None:
    """Reads stop requests from standard input; its end means that the supervisor is gone."""
    for line in sys.stdin:
        event = json.loads(line)
        heartbeat.request_stop(ExitStatus(event["exit_status"], event["stop"]))
    heartbeat.request_stop(ExitStatus(RunError.exit_status, "the supervisor is gone"))


def _wait(service: Service, heartbeat: Heartbeat) -> None:
    """Waits for the service; one that does not come back from its engine is left behind."""
    while service.is_alive() and heartbeat.stop is None and not heartbeat.lost:
        service.join(0.2)
    interrupted_run = heartbeat.stop is not None and heartbeat.stop.code > SIGNAL_STATUS
    service.join(GRACE_S + LAST_WORD_S + (KEEP_S if interrupted_run else 0.0))
    if service.is_alive():
        status = heartbeat.stop or ExitStatus(RunError.exit_status, heartbeat.lost)
        say(f"{service.name}: {status.reason}")
        os._exit(status.code)  # nothing here needs closing
