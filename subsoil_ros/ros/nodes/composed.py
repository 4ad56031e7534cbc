"""The nodes of a run in one process, one thread each."""

from collections.abc import Callable, Mapping
from functools import partial

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ...coupling.exit_status import ExitStatus, interrupted
from ...coupling.observer import RunObserver
from ...coupling.protocol import CONTROLLER, COUPLER, MECHANISM, RECORDER, SOIL, external_nodes
from ...coupling.run_settings import RunSettings
from ..process.heartbeat import Heartbeat
from ..process.node_plan import ros_arguments
from ..process.node_process import Service, watched_by
from . import controller_node, coupler_node, mechanism_node, recorder_node, soil_node
from .lockstep_node import LockstepNode

Build = Callable[[RunSettings, Heartbeat, Context], LockstepNode]
"""Builds a node with its engine."""


def scene_builds(run: RunSettings, observer: RunObserver | None = None) -> dict[str, Build]:
    """Return the functions that build the nodes of a scene, by name, without nodes of other programs.

    observer: receives ticks and checks from the coupler.
    """
    builds: dict[str, Build] = {
        MECHANISM: mechanism_node.build,
        SOIL: soil_node.build,
        RECORDER: recorder_node.build,
        COUPLER: partial(coupler_node.CouplerNode, observer=observer),
        CONTROLLER: controller_node.build,
    }
    left_out = external_nodes(run.resolved.scene)
    return {name: builds[name] for name in (*run.participants, COUPLER) if name not in left_out}


def run_composed(
    run: RunSettings, builds: Mapping[str, Build], observer: RunObserver | None = None, namespace: str = ""
) -> ExitStatus:
    """Run the nodes until the run ends.

    Args:
        builds: functions that build the nodes that the scene needs, and the coupler.
        observer: asked several times a second for a signal that ends the run.
        namespace: namespace of all nodes (plan.checked_namespace).
    """
    observer = observer or RunObserver()
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
            signal_number = observer.stop_signal()
            if signal_number:
                heartbeats[COUPLER].request_stop(interrupted(signal_number))
        for service in services.values():
            service.close()
    finally:
        for heartbeat in heartbeats.values():
            heartbeat.close()
        rclpy.shutdown(context=context)
    return coupler.status
