"""A machine or a soil of another program joins a run as a node."""

import os
import threading
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import partial
from os import PathLike
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ...api.load import SceneLike, resolved_scene
from ...api.run_frame import run_id_of
from ...coupling.exit_status import ExitStatus, caught_signals, interrupted
from ...coupling.external import (
    ExternalMachineEngine,
    ExternalSoil,
    ExternalSoilEngine,
    Machine,
    refuse_unlike,
)
from ...coupling.protocol import MECHANISM, SOIL
from ...coupling.run_settings import RunSettings
from ...coupling.time_limits import KEEP_S, LAST_WORD_S, LATE_S, RETURN_S
from ...errors import InputError, RunError
from ...loading.loader import ResolvedScene
from ...recording.checkpoint import read_checkpoint
from ..process.heartbeat import Heartbeat
from ..process.node_plan import checked_namespace, ros_arguments
from ..process.node_process import OWN_TIME, Served, Service, say, watched_by
from ..transport.environment import check_environment
from ..transport.shared_memory import avoid_full_memory
from . import mechanism_node, soil_node


def serve(
    scene: SceneLike | ResolvedScene,
    machine: Machine | None = None,
    *,
    soil: ExternalSoil | None = None,
    overrides: Mapping[str, object] | None = None,
    run_id: str | None = None,
    checkpoints: str | PathLike[str] | None = None,
    resume: str | PathLike[str] | None = None,
    namespace: str = "",
) -> None:
    """Join a run as its machine or its soil, and return when the run has reached its end.

    `subsoil run` or `ros2 launch` starts the other nodes, in the domain ROS_DOMAIN_ID. The numbers are those
    of run(scene, machine=machine), bit for bit.

    Args:
        scene: the same for all nodes; as load_scene takes it, or gives it.
        machine, soil: one of them, as in run.
        overrides: as in load_scene.
        run_id: name of the run; unless given the one that `subsoil run` and the launch file use.
        checkpoints: folder of the checkpoints, the same for all nodes: OUT/checkpoints of `subsoil run`.
        resume: checkpoint to continue from, the same for all nodes.
        namespace: namespace of all nodes.

    Raises:
        InputError: the object or an argument cannot be used.
        InterruptedRunError: the run was interrupted.
        RunError: the run failed; the message has the cause.
    """
    check_environment()
    resolved = resolved_scene(scene, overrides)
    if (machine is None) == (soil is None):
        raise InputError("serve: give a machine or a soil, one of them")
    refuse_unlike(resolved, machine, soil, alone=False)
    engine = ExternalMachineEngine(resolved, machine) if soil is None else ExternalSoilEngine(resolved, soil)
    if resolved.scene.checkpoint_s > 0.0 and checkpoints is None:
        raise InputError(
            f"serve: the scene writes checkpoints every {resolved.scene.checkpoint_s:g} s; give "
            "checkpoints=FOLDER, 'checkpoints' in the folder of the run, or set record.checkpoint_s: 0"
        )
    run = RunSettings(
        resolved,
        run_id or run_id_of(resolved),
        checkpoints=Path(checkpoints) if checkpoints is not None and engine.keeps_state else None,
        resumed=read_checkpoint(Path(resume), resolved.scene_hash) if resume is not None else None,
    )
    status = _serve(run, engine, checked_namespace(namespace))
    if status.code == InputError.exit_status:
        raise InputError(status.reason)
    if status.code:
        raise status.error()


def _serve(
    run: RunSettings, engine: ExternalMachineEngine | ExternalSoilEngine, namespace: str
) -> ExitStatus:
    build: Callable[..., Served]
    if isinstance(engine, ExternalMachineEngine):
        name, build = MECHANISM, partial(mechanism_node.build, engine=engine)
    else:
        name, build = SOIL, partial(soil_node.build, engine=engine)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    notice = avoid_full_memory()
    if notice:
        say(f"{name}: {notice}")
    context = Context()
    words = ros_arguments({}, namespace)
    rclpy.init(args=words, context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = Node(f"{name}_process", context=context, parameter_overrides=OWN_TIME)
    heartbeat = Heartbeat(node, name, run, watched_by(name, run))
    service = Service(name, partial(build, run, heartbeat, context), heartbeat)
    main = threading.current_thread() is threading.main_thread()  # signals reach no other
    stop = caught_signals(lambda number: heartbeat.request_stop(interrupted(number)))
    try:
        with stop if main else nullcontext():
            heartbeat.start()
            service.start()
            while not service.ended.wait(0.2) and heartbeat.stop is None and not heartbeat.lost:
                pass
            if not service.ended.wait(RETURN_S + LAST_WORD_S + KEEP_S):  # a method has not returned
                return heartbeat.stop or ExitStatus(RunError.exit_status, heartbeat.lost)
        if service.status.code:
            heartbeat.outlast(LATE_S)  # a coupler that starts later would wait for this node
        service.close()
        return service.status
    finally:
        heartbeat.close()
        rclpy.shutdown(context=context)
