"""The work of `subsoil run` in each mode; separate from its arguments, because it imports all libraries."""

import argparse
import os
import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ...analysis.summary import KnownMean, Summary
from ...api.checkpoints import name_checkpoint
from ...api.opened_run import OpenedRun, open_run
from ...api.results import conclude
from ...api.simulate import needed_controller, simulate_opened
from ...coupling.outside import refuse_unlike
from ...coupling.protocol import COUPLER, nodes_from_outside
from ...coupling.signals import caught_signals
from ...coupling.stopping import OnCheck
from ...errors import InputError, SubsoilError
from ...extras import require_ros
from ...loading.loader import ResolvedScene, load_scene
from ...report.metrics_table import print_summary
from ...report.sentences import mean_words
from ...ros.process.plan import RunPlan, checked_namespace
from ...ros.process.supervisor import Supervisor, node_program, start_node
from ...ros.transport.domain import run_domain
from ...ros.transport.shared_memory import avoid_full_memory
from .bed_preparation import bed_progress
from .live import live_port, say_where
from .preparation import KernelAnnouncer, announce_kernels_of_nodes, say, say_opened
from .progress import RunProgress, reading_bag, working


def simulate(args: argparse.Namespace) -> int:
    """Run the scene with the arguments of `subsoil run`. Raises as run.run does."""
    kernels = KernelAnnouncer()
    with kernels:
        return _run(args, kernels)


def _run(args: argparse.Namespace, kernels: KernelAnnouncer) -> int:
    resolved = load_scene(args.scene, args.overrides)
    namespace = checked_namespace(args.namespace)
    if args.mode == "direct":
        _refuse_direct(args, resolved)
    else:
        require_ros(f"--mode {args.mode}", "give --mode direct")
    live = live_port(args.live)
    if live and not resolved.scene.record.bag:
        raise InputError("--live: shows what is recorded, and record.bag is false; add --set record.bag=true")
    out = Path(args.out)
    opened = open_run(resolved, out, args.threads, args.resume, shown=args.scene, bed_progress=bed_progress)
    say_opened(opened)
    say_where(live)
    failure: SubsoilError | None = None
    signals: list[int] = []
    found: dict[str, Any] = {}  # of the mean of stop_when

    def stop_signal() -> int:
        return signals[0] if signals else 0

    start = time.monotonic()
    try:
        with caught_signals(signals.append), RunProgress(resolved.scene.name, resolved.timing) as bar:
            progress = kernels.before(bar)

            def on_check(result: Mapping[str, Any]) -> None:
                found.update(result)
                bar.note(mean_words(KnownMean.model_validate(result)))

            if args.mode == "direct":
                simulate_opened(opened, args.threads, progress, stop_signal, live, on_check)
            else:
                plan = RunPlan.of(opened, args.threads, args.paused, supervised=True, live=live)
                if args.mode == "composed":
                    _run_composed(opened, plan, namespace, progress, on_check, stop_signal)
                else:
                    _run_nodes(plan, namespace, out / "log", progress, on_check, stop_signal)
    except SubsoilError as error:
        failure = error
    if failure is not None and failure.exit_status == InputError.exit_status and not bar.started:
        shutil.rmtree(out)  # bad input detected only with the prepared bed: nothing ran
        raise failure
    facts = {"mode": args.mode, "threads": args.threads, "whole_wall_s": time.monotonic() - start}
    facts |= {"stop_when": found} if found else {}
    if failure is not None:
        name_checkpoint(failure, out, opened.resumed)
    summary = conclude(opened, facts, failure, reading=reading_bag, working=working)
    if isinstance(summary, Summary):
        print_summary(summary, resolved.scene, out, reference=resolved.reference)
    elif summary is not None:
        print(f"nothing is recorded (record.bag: false); {out / 'summary.json'} says how the run ended")
    if failure is not None:
        raise failure
    return 0


def _refuse_direct(args: argparse.Namespace, resolved: ResolvedScene) -> None:
    """Raise InputError if the run needs nodes."""
    if args.namespace:
        raise InputError("--namespace: a direct run has no nodes; use --mode nodes or composed")
    if args.paused:
        raise InputError("--paused: a direct run has no services to resume it; use --mode nodes or composed")
    needed_controller(resolved)
    refuse_unlike(resolved, None, None)


def _say_where_nodes_are(plan: RunPlan, domain: int, namespace: str) -> None:
    """Print where other programs find the nodes, and which nodes must be started by the user."""
    place = f", namespace {namespace}" if namespace else ""
    say(f"nodes in ROS_DOMAIN_ID={domain}{place}")
    for node, key in nodes_from_outside(plan.resolved.scene).items():
        print(
            f"waiting for a node '{node}' of run '{plan.run_id}' in ROS_DOMAIN_ID={domain}{place} ({key})",
            flush=True,
        )
    if plan.paused:
        print(
            f"paused before the first tick; ROS_DOMAIN_ID={domain} ros2 service call "
            f"{namespace}/{COUPLER}/resume std_srvs/srv/Trigger lets it go",
            flush=True,
        )


def _avoid_full_memory(process_count: int) -> None:
    """Says so if messages cannot go through shared memory."""
    words = avoid_full_memory(process_count)
    if words:
        say(words)


def _run_composed(
    opened: OpenedRun,
    plan: RunPlan,
    namespace: str,
    progress: Callable[[int], None],
    on_check: OnCheck,
    stop_signal: Callable[[], int],
) -> None:
    with run_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        _avoid_full_memory(1)
        from ...ros.process.composed import run_composed, scene_builds  # not for other modes: needs ROS
        from ...ros.process.heartbeat import NodeRun

        node_run = NodeRun(opened.run_id, opened.resolved, opened.checkpoints, opened.resumed)
        builds = scene_builds(node_run, plan.bag, plan.threads, progress, plan.paused, plan.live, on_check)
        _say_where_nodes_are(plan, domain, namespace)
        status = run_composed(node_run, builds, stop_signal, namespace)
    if status.code:
        raise status.error()


def _run_nodes(
    plan: RunPlan,
    namespace: str,
    logs: Path,
    progress: Callable[[int], None],
    on_check: OnCheck,
    stop_signal: Callable[[], int],
) -> None:
    progress = announce_kernels_of_nodes(progress)
    logs.mkdir()
    with run_domain() as domain:
        _avoid_full_memory(len(plan.nodes()))
        _say_where_nodes_are(plan, domain, namespace)
        processes = [
            start_node(
                node.name,
                node_program(node.name),
                logs / f"{node.name}.log",
                node.parameters,
                domain,
                namespace,
            )
            for node in plan.nodes()
        ]
        status = Supervisor(processes, progress, on_check).follow(stop_signal)
    if status.code:
        raise status.error()
