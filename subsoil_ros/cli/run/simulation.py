"""The work of `subsoil run` in each mode; separate from its arguments, because it imports all libraries."""

import argparse
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

from ...analysis.summary import KnownMean, Summary
from ...api.run_frame import RunFrame, needed_controller, open_run
from ...coupling.exit_status import caught_signals
from ...coupling.external import refuse_unlike
from ...coupling.observer import RunObserver, RunWatch
from ...coupling.protocol import COUPLER, external_nodes
from ...coupling.run_options import OPTIONS
from ...coupling.run_settings import RunSettings
from ...errors import InputError
from ...extras import require, require_ros
from ...loading.loader import ResolvedScene, load_scene
from ...ros.process.mpi import mpiexec
from ...ros.process.node_plan import checked_namespace, nodes_of
from ...ros.process.supervisor import Supervisor, node_program, start_node
from ...ros.transport.environment import check_environment
from ...ros.transport.ros_domain import run_domain
from ...ros.transport.shared_memory import avoid_full_memory
from ...run_results import mean_words, print_summary
from ...yaml_document import Document
from ..output import say
from ..progress import (
    KernelAnnouncer,
    RunProgress,
    announce_kernels_of_nodes,
    bed_progress,
    reading_bag,
    working,
)


def simulate(args: argparse.Namespace) -> int:
    """Run the scene with the arguments of `subsoil run`. Raises as run.run does."""
    kernels = KernelAnnouncer()
    with kernels:
        return _run(args, kernels)


def _usual_folder(scene: Path) -> Path:
    """runs/SCENE-TIME; a file scene.yaml is called as its folder."""
    name = scene.resolve().parent.name if scene.stem == "scene" else scene.stem
    return Path("runs") / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"


def _run(args: argparse.Namespace, kernels: KernelAnnouncer) -> int:
    resolved = load_scene(args.scene, args.overrides)
    namespace = checked_namespace(args.namespace)
    if args.mode == "direct":
        _refuse_direct(args, resolved)
    else:
        require_ros(f"--mode {args.mode}", "give --mode direct")
        check_environment()
    _refuse_ranks(args)
    live = live_port(args.live)
    if live and not resolved.scene.record.bag:
        raise InputError("--live: shows what is recorded, and record.bag is false; add --set record.bag=true")
    settings = RunSettings(
        resolved,
        live_port=live,
        supervised=args.mode == "nodes",
        **{name: getattr(args, name) for name in OPTIONS},
    )
    out = Path(args.out) if args.out is not None else _usual_folder(resolved.path)
    frame = open_run(settings, out, args.resume, shown=args.scene, bed_progress=bed_progress)
    if args.out is None:
        print(f"results: {frame.out}")
    say_opened(frame)
    say_where(live)
    bar = RunProgress(resolved.scene.name, resolved.timing)
    watch = _ShownRun(bar, kernels.before(bar))

    def work() -> None:
        with caught_signals(watch.signals.append), bar:
            if args.mode == "direct":
                frame.simulate(watch)
            elif args.mode == "composed":
                _run_composed(frame, namespace, watch)
            else:
                _run_nodes(frame, namespace, watch)

    summary, failure = frame.complete(args.mode, work, watch, reading=reading_bag, working=working)
    if isinstance(summary, Summary):
        print_summary(summary, resolved.scene, frame.out, reference=resolved.reference)
    elif summary is not None:
        print(f"nothing is recorded (record.bag: false); {frame.out / 'summary.json'} says how the run ended")
    if failure is not None:
        raise failure
    return 0


class _ShownRun(RunWatch):
    """Shows the ticks of a run and the mean of stop_when in its bar."""

    def __init__(self, bar: RunProgress, show: Callable[[int], None]) -> None:
        super().__init__(show)
        self._bar = bar

    def on_check(self, result: Document) -> None:
        super().on_check(result)
        self._bar.note(mean_words(KnownMean.model_validate(result)))


def _refuse_direct(args: argparse.Namespace, resolved: ResolvedScene) -> None:
    """Raise InputError if the run needs nodes."""
    if args.namespace:
        raise InputError("--namespace: a direct run has no nodes; use --mode nodes or composed")
    if args.paused:
        raise InputError("--paused: a direct run has no services to resume it; use --mode nodes or composed")
    needed_controller(resolved)
    refuse_unlike(resolved, None, None)


def _refuse_ranks(args: argparse.Namespace) -> None:
    """Raise InputError if ranks are asked for that cannot be started."""
    if args.ranks > 1:
        if args.mode != "nodes":
            raise InputError(
                f"--ranks: given {args.ranks}, but --mode {args.mode} has one process; use --mode nodes"
            )
        mpiexec()


def _say_where_nodes_are(run: RunSettings, domain: int, namespace: str) -> None:
    """Print where other programs find the nodes, and which nodes must be started by the user."""
    place = f", namespace {namespace}" if namespace else ""
    say(f"nodes in ROS_DOMAIN_ID={domain}{place}")
    for node, key in external_nodes(run.resolved.scene).items():
        print(
            f"waiting for a node '{node}' of run '{run.run_id}' in ROS_DOMAIN_ID={domain}{place} ({key})",
            flush=True,
        )
    if run.paused:
        print(
            f"paused before the first tick; ROS_DOMAIN_ID={domain} ros2 service call "
            f"{namespace}/{COUPLER}/resume std_srvs/srv/Trigger lets it go",
            flush=True,
        )


def _run_composed(frame: RunFrame, namespace: str, observer: RunObserver) -> None:
    with run_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        if words := avoid_full_memory(1):
            say(words)
        from ...ros.nodes.composed import run_composed, scene_builds

        _say_where_nodes_are(frame.settings, domain, namespace)
        builds = scene_builds(frame.settings, observer)
        status = run_composed(frame.settings, builds, observer, namespace)
    if status.code:
        raise status.error()


def _run_nodes(frame: RunFrame, namespace: str, watch: RunWatch) -> None:
    watch.show = announce_kernels_of_nodes(watch.show)
    logs = frame.out / "log"
    logs.mkdir()
    nodes = nodes_of(frame.settings, frame.scene)
    with run_domain() as domain:
        if words := avoid_full_memory(len(nodes)):
            say(words)
        _say_where_nodes_are(frame.settings, domain, namespace)
        processes = [
            start_node(name, node_program(name), logs / f"{name}.log", parameters, domain, namespace)
            for name, parameters in ((node.name, node.parameters) for node in nodes)
        ]
        status = Supervisor(processes, watch).follow()
    if status.code:
        raise status.error()


def live_port(wanted: str | None) -> int:
    """Return a port that is free now; 0 without a live view.

    Raises:
        InputError: the value is no port, the port is in use, or foxglove-sdk is not installed.
    """
    if wanted is None:
        return 0
    require("--live", "foxglove")
    from ...recording.live_view import HOST

    if not wanted.isdecimal() or int(wanted) > 65535:
        raise InputError(f"live view: given '{wanted}'; it must be a port from 1024 to 65535, or 0 for any")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, int(wanted)))
        except OSError as error:
            raise InputError(
                f"live view: port {wanted} cannot be used ({error.strerror}); name another, or 0 for any "
                "that is free"
            ) from error
        return int(probe.getsockname()[1])


def say_where(port: int) -> None:
    """Print the address of the live view, if there is one."""
    if port:
        from ...recording.live_view import HOST

        print(f"live view: ws://{HOST}:{port} (Foxglove: Open connection, Foxglove WebSocket)", flush=True)


def say_opened(frame: RunFrame) -> None:
    """Print warnings on standard error and notes on standard output before a run begins."""
    for warning in frame.warnings:
        say(f"warning: {warning}")
    for note in frame.notes:
        print(note, flush=True)
