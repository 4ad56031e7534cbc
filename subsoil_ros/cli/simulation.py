"""What `subsoil run` does, in each of its modes. Apart from its arguments: this needs all libraries."""

import argparse
import os
import shutil
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from ..analysis.series import read_series, write_series_csv
from ..analysis.summary import print_summary, summarize, summarize_unrecorded, write_summary
from ..analysis.versions import versions
from ..coupling.control import build_controller
from ..coupling.direct import run_direct
from ..coupling.engines import build_soil
from ..coupling.protocol import CONTROLLER, COUPLER
from ..coupling.resumption import Keeper
from ..errors import InputError, RecordingError, SubsoilError
from ..nodes.domain import run_domain
from ..nodes.plan import RunPlan, checked_namespace
from ..nodes.signals import caught_signals
from ..recording.bag_writer import open_bag
from ..recording.joined import mend_earlier
from ..recording.recovery import recover
from ..scene.loader import ResolvedScene, load_scene
from .live import live_port, say_where
from .opened_run import OpenedRun, open_run
from .preparation import KernelAnnouncer, announce_kernels_of_nodes, say
from .progress import RunProgress, reading_bag, working
from .resumption import CHECKPOINTS, checkpoint_facts, name_checkpoint
from .supervisor import Supervisor, node_program, start_node


def simulate(args: argparse.Namespace) -> int:
    """Runs the scene as the arguments of `subsoil run` say. Raises as run.run does."""
    with KernelAnnouncer() as kernels:
        return _run(args, kernels)


def _run(args: argparse.Namespace, kernels: KernelAnnouncer) -> int:
    resolved = load_scene(args.scene, args.overrides)
    namespace = checked_namespace(args.namespace)
    if args.mode == "direct":
        _refuse_direct(args, resolved)
    elif find_spec("rclpy") is None or find_spec("subsoil_msgs") is None:
        raise InputError(
            f"--mode {args.mode}: needs ROS 2 with rclpy and subsoil_msgs, which are not installed here; "
            "install them as docs/install.md says, or give --mode direct"
        )
    live = live_port(args.live)
    if live and not resolved.scene.record.bag:
        raise InputError("--live: shows what is recorded, and record.bag is false; add --set record.bag=true")
    opened = open_run(resolved, args.scene, Path(args.out), args.threads, args.resume)
    out, resumed = opened.out, opened.resumed
    say_where(live)
    failure: SubsoilError | None = None
    signals: list[int] = []

    def stop_signal() -> int:
        return signals[0] if signals else 0

    start = time.monotonic()
    try:
        with caught_signals(signals.append), RunProgress(resolved.scene.name, resolved.timing) as bar:
            progress = kernels.before(bar)
            if args.mode == "direct":
                _run_direct(opened, args.threads, live, progress, stop_signal)
            elif args.mode == "composed":
                _run_composed(opened, args.threads, args.paused, live, namespace, progress, stop_signal)
            else:
                plan = opened.plan(args.threads, args.paused, supervised=True, live=live)
                _run_nodes(plan, namespace, out / "log", progress, stop_signal)
    except SubsoilError as error:
        failure = error
    if failure is not None and failure.exit_status == InputError.exit_status and not bar.started:
        shutil.rmtree(out)  # bad input that showed only when the bed was there: nothing ran
        raise failure
    wall_s = time.monotonic() - start
    facts = {"mode": args.mode, "threads": args.threads, "whole_wall_s": wall_s, "versions": versions()}
    if failure is not None:
        name_checkpoint(failure, out, resumed)
    _summarize(resolved, out, facts | checkpoint_facts(out, resumed), failure)
    if failure is not None:
        raise failure
    return 0


def _refuse_direct(args: argparse.Namespace, resolved: ResolvedScene) -> None:
    """InputError if the run needs what only nodes can do."""
    if args.namespace:
        raise InputError("--namespace: a direct run has no nodes; use --mode nodes or composed")
    if args.paused:
        raise InputError("--paused: a direct run has no services to resume it; use --mode nodes or composed")
    if resolved.scene.controller is not None and build_controller(resolved) is None:
        raise InputError(
            f"{args.scene}: controller.law: 'external' is a node of somebody else, and a direct run has no "
            "nodes; use --mode nodes or composed"
        )


def _say_what_it_waits_for(
    resolved: ResolvedScene, run_id: str, domain: int, namespace: str, paused: bool
) -> None:
    """Tells the user what must come from outside, and where."""
    if resolved.scene.controller is not None and build_controller(resolved) is None:
        place = f", namespace {namespace}" if namespace else ""
        print(
            f"waiting for a node '{CONTROLLER}' of run '{run_id}' in ROS_DOMAIN_ID={domain}{place} "
            "(controller.law: external)",
            flush=True,
        )
    if paused:
        print(
            f"paused before the first tick; ROS_DOMAIN_ID={domain} ros2 service call "
            f"{namespace}/{COUPLER}/resume std_srvs/srv/Trigger lets it go",
            flush=True,
        )


def _say_domain(domain: int, namespace: str) -> None:
    """Tells the user where other programs find the nodes."""
    say(f"nodes in ROS_DOMAIN_ID={domain}{f', namespace {namespace}' if namespace else ''}")


def _run_direct(
    opened: OpenedRun,
    threads: int,
    live: int,
    progress: Callable[[int], None],
    stop_signal: Callable[[], int],
) -> None:
    resolved, resumed = opened.resolved, opened.resumed
    writer = open_bag(opened.out / "bag", resolved, live) if resolved.scene.record.bag else None
    sync = (writer.sync,) if writer is not None else ()
    try:
        soil = build_soil(resolved, threads)
        keeper = Keeper(opened.out / CHECKPOINTS, resolved, opened.run_id, *sync)
        controller = build_controller(resolved, resumed)
        run_direct(
            resolved,
            opened.run_id,
            opened.mover,
            soil,
            writer,
            progress,
            stop_signal,
            keeper,
            resumed,
            controller,
        )
    finally:
        if writer is not None:
            writer.close()


def _run_composed(
    opened: OpenedRun,
    threads: int,
    paused: bool,
    live: int,
    namespace: str,
    progress: Callable[[int], None],
    stop_signal: Callable[[], int],
) -> None:
    with run_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        from ..nodes.composed import run_composed, scene_builds  # the other modes need no ROS here
        from ..nodes.lifeline import NodeRun

        node_run = NodeRun(opened.run_id, opened.resolved, opened.out / CHECKPOINTS, opened.resumed)
        builds = scene_builds(node_run, opened.out / "bag", threads, progress, paused, live)
        _say_domain(domain, namespace)
        _say_what_it_waits_for(opened.resolved, opened.run_id, domain, namespace, paused)
        ending = run_composed(node_run, builds, stop_signal, namespace)
    if ending.exit_status:
        raise ending.error()


def _run_nodes(
    plan: RunPlan,
    namespace: str,
    logs: Path,
    progress: Callable[[int], None],
    stop_signal: Callable[[], int],
) -> None:
    progress = announce_kernels_of_nodes(progress)
    logs.mkdir()
    with run_domain() as domain:
        _say_domain(domain, namespace)
        _say_what_it_waits_for(plan.resolved, plan.run_id, domain, namespace, plan.paused)
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
        ending = Supervisor(processes, progress).follow(stop_signal)
    if ending.exit_status:
        raise ending.error()


def _summarize(
    resolved: ResolvedScene, out: Path, run_info: dict[str, object], failure: SubsoilError | None
) -> None:
    """Makes series and summary from the bag; of a run that failed, if there is anything to show."""
    bag = out / "bag"
    if failure is not None:
        run_info = run_info | {"failure": str(failure)}
    try:
        if not resolved.scene.record.bag:
            write_summary(summarize_unrecorded(resolved, run_info), out / "summary.json")
            print(f"nothing is recorded (record.bag: false); {out / 'summary.json'} says how the run ended")
            return
        if failure is not None:
            with working("looking after the bag"):
                recover(bag)  # its writer may have been killed; a whole bag is left as it is
        mend_earlier(out)
        with reading_bag(resolved.timing) as watch:
            series = read_series(bag, resolved.scene, watch)
        write_series_csv(series, out / "series.csv")
        with working("reading the clouds"):
            summary = summarize(bag, resolved, run_info, series)
        write_summary(summary, out / "summary.json")
        print_summary(summary, resolved.scene, out, reference=resolved.reference)
    except SubsoilError:
        if failure is None:
            raise
    except OSError as error:
        if failure is None:
            raise RecordingError(f"{out}: the results cannot be written ({error.strerror})") from error
