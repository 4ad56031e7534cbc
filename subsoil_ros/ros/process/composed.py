"""The nodes of a run in one process, one thread each."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ...coupling.exit_status import ExitStatus, interrupted
from ...coupling.protocol import CONTROLLER, COUPLER, MECHANISM, RECORDER, SOIL, nodes_from_outside
from ...coupling.stopping import OnCheck
from ..nodes import controller_node, coupler_node, mechanism_node, recorder_node, soil_node
from ..nodes.lockstep_node import LockstepNode
from .heartbeat import Heartbeat, NodeRun
from .node_process import watched_by
from .node_thread import Service
from .parameters import NodeSettings
from .plan import ros_arguments

Build = Callable[[NodeRun, Heartbeat, Context], LockstepNode]
"""Builds a node with its engine."""


def scene_builds(
    run: NodeRun,
    bag: Path,
    threads: int,
    on_progress: Callable[[int], None],
    paused: bool = False,
    live: int = 0,
    on_check: OnCheck = lambda result: None,
) -> dict[str, Build]:
    """Return the functions that build the nodes of a scene, by name, without nodes of other programs.

    live: port of the recorder's live view; 0: there is none.
    """
    settings = NodeSettings(
        str(run.resolved.path), run.run_id, threads, str(bag), run.recorded, supervised=False, live=live
    )
    builds: dict[str, Build] = {
        MECHANISM: partial(mechanism_node.build, settings),
        SOIL: partial(soil_node.build, settings),
        RECORDER: partial(recorder_node.build, settings),
        COUPLER: partial(coupler_node.CouplerNode, on_progress=on_progress, paused=paused, on_check=on_check),
        CONTROLLER: partial(controller_node.build, settings),
    }
    left_out = nodes_from_outside(run.resolved.scene)
    return {name: builds[name] for name in (*run.participants, COUPLER) if name not in left_out}


def run_composed(
    run: NodeRun, builds: Mapping[str, Build], stop_signal: Callable[[], int], namespace: str = ""
) -> ExitStatus:
    """Run the nodes until the run ends.

    Args:
        builds: functions that build the nodes that the scene needs, and the coupler.
        stop_signal: called several times a second; a signal's number other than 0 ends the run.
        namespace: namespace of all nodes (plan.checked_namespace).
    """
    context = Context()
    words = [*ros_arguments({}, namespace), "--disable-stdout-logs"]  # the console is that of `subsoil run`
    rclpy.init(args=words, context=context, signal_handler_options=SignalHandlerOptions.NO)
    heartbeats: dict[str, Heartbeat] = {}
    services: dict[str, Service] = {}
    try:
        for name, build in builds.items():
            node = Node(f"{name}_process", context=context)
            heartbeat = heartbeats[name] = Heartbeat(node, name, run, watched_by(name, run))
            services[name] = Service(name, partial(build, run, heartbeat, context), heartbeat)
        for name, service in services.items():
            heartbeats[name].start()
            service.start()
        coupler = services[COUPLER]
        while not coupler.ended.wait(0.1):
            signal_number = stop_signal()
            if signal_number:
                heartbeats[COUPLER].request_stop(interrupted(signal_number))
        for service in services.values():
            service.close()
    finally:
        for heartbeat in heartbeats.values():
            heartbeat.close()
        rclpy.shutdown(context=context)
    return coupler.status
