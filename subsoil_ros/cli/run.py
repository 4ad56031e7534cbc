"""subsoil run SCENE --out DIR: simulates a scene and leaves a bag, a series and a summary."""

import argparse
import os
import shutil
import time
import uuid
from collections.abc import Callable
from pathlib import Path

from ..analysis.series import read_series, write_series_csv
from ..analysis.summary import print_summary, summarize, summarize_unrecorded, write_summary
from ..coupling.control import build_controller
from ..coupling.direct import run_direct
from ..coupling.engines import Mover, build_mechanism, build_paths, build_soil
from ..coupling.protocol import CONTROLLER, COUPLER, RECORDER, SOIL, participants
from ..coupling.resumption import Keeper
from ..errors import InputError, RecordingError, SceneError, SubsoilError
from ..nodes.domain import run_domain
from ..nodes.signals import caught_signals
from ..recording.bag_writer import BagWriter
from ..recording.checkpoint import Checkpoint
from ..recording.joined import mend_earlier
from ..recording.recovery import recover
from ..scene.limits import step_notes
from ..scene.loader import ResolvedScene, load_scene
from .arguments import add_overrides
from .preparation import KernelAnnouncer, announce_kernels_of_nodes
from .progress import RunProgress
from .resumption import CHECKPOINTS, checkpoint_facts, find_checkpoint, name_checkpoint, note_resumption
from .supervisor import Parameters, Supervisor, node_program, start_node

SUMMARY = "simulate a scene; DIR gets bag/, scene.yaml, series.csv, summary.json and log/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `subsoil run`."""
    parser.add_argument("scene", help="scene file (.yaml)")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for the results; must not exist")
    parser.add_argument(
        "--mode",
        choices=("nodes", "composed", "direct"),
        default="nodes",
        help="nodes: one process per node over DDS; composed: the same nodes in one process; "
        "direct: no ROS (default: nodes; the results are the same bits)",
    )
    add_overrides(parser)
    parser.add_argument(
        "--threads",
        type=_thread_count,
        default=1,
        metavar="N",
        help="threads of the soil engine (default: 1)",
    )
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="RUN",
        help="go on from the newest checkpoint in the folder of an earlier run of the same scene",
    )
    parser.add_argument(
        "--paused",
        action="store_true",
        help="nodes and composed: stand before the first tick until the coupler's services resume or step "
        "are called",
    )


def _thread_count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no number of threads; give 1 or more")
    return int(text)


def run(args: argparse.Namespace) -> int:
    """Run the scene.

    Raises:
        InputError: the scene or the folder cannot be used; nothing was written.
        RunError: the run failed; what was recorded before is in the folder.
    """
    with KernelAnnouncer() as kernels:
        return _run(args, kernels)


def _run(args: argparse.Namespace, kernels: KernelAnnouncer) -> int:
    resolved = load_scene(args.scene, args.overrides)
    resumed = find_checkpoint(args.resume, resolved) if args.resume is not None else None
    if args.mode == "direct":
        _refuse_direct(args, resolved)
    try:
        mover = build_mechanism(resolved) or build_paths(resolved)
        _prepare_bed(resolved, args.threads)
    except SceneError as error:
        raise SceneError(f"{args.scene}: {error}") from error
    out = _create_folder(Path(args.out))
    resolved.write(out / "scene.yaml")
    if resumed is not None:
        note_resumption(resumed, args.resume, resolved, out)
    run_id = uuid.uuid4().hex[:12]
    for note in _notes(resolved):
        print(note, flush=True)
    failure: SubsoilError | None = None
    signals: list[int] = []

    def stop_signal() -> int:
        return signals[0] if signals else 0

    start = time.monotonic()
    try:
        with caught_signals(signals.append), RunProgress(resolved.scene.name, resolved.timing) as bar:
            progress = kernels.before(bar)
            if args.mode == "direct":
                _run_direct(resolved, mover, run_id, out, args.threads, progress, stop_signal, resumed)
            elif args.mode == "composed":
                _run_composed(
                    resolved, run_id, out, args.threads, progress, stop_signal, resumed, args.paused
                )
            else:
                _run_nodes(resolved, run_id, out, args.threads, progress, stop_signal, resumed, args.paused)
    except SubsoilError as error:
        failure = error
    if failure is not None and failure.exit_status == InputError.exit_status and not bar.started:
        shutil.rmtree(out)  # bad input that showed only when the bed was there: nothing ran
        raise failure
    wall_s = time.monotonic() - start
    facts = {"mode": args.mode, "threads": args.threads, "whole_wall_s": wall_s}
    if failure is not None:
        name_checkpoint(failure, out, resumed)
    _summarize(resolved, out, facts | checkpoint_facts(out, resumed), failure)
    if failure is not None:
        raise failure
    return 0


def _refuse_direct(args: argparse.Namespace, resolved: ResolvedScene) -> None:
    """InputError if the run needs what only nodes can do."""
    if args.paused:
        raise InputError("--paused: a direct run has no services to resume it; use --mode nodes or composed")
    if resolved.scene.controller is not None and build_controller(resolved) is None:
        raise InputError(
            f"{args.scene}: controller.law: 'external' is a node of somebody else, and a direct run has no "
            "nodes; use --mode nodes or composed"
        )


def _say_what_it_waits_for(resolved: ResolvedScene, run_id: str, domain: int, paused: bool) -> None:
    """Tells the user what must come from outside, and where."""
    if resolved.scene.controller is not None and build_controller(resolved) is None:
        print(
            f"waiting for a node '{CONTROLLER}' of run '{run_id}' in ROS_DOMAIN_ID={domain} "
            "(controller.law: external)",
            flush=True,
        )
    if paused:
        print(
            f"paused before the first tick; ROS_DOMAIN_ID={domain} ros2 service call /{COUPLER}/resume "
            "std_srvs/srv/Trigger lets it go",
            flush=True,
        )


def _prepare_bed(resolved: ResolvedScene, threads: int) -> None:
    if resolved.scene.particle_soil is None:
        return  # without particles none of their code is imported
    from ..dem.beds.prepare import check_start
    from .bed_preparation import prepare_bed_first

    check_start(resolved)
    prepare_bed_first(resolved, threads)


def _notes(resolved: ResolvedScene) -> tuple[str, ...]:
    soil = resolved.scene.particle_soil
    of_the_step = step_notes(soil, resolved.timing.soil_step_s) if soil is not None else ()
    return (*resolved.notes, *of_the_step)


def _create_folder(out: Path) -> Path:
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        raise InputError(
            f"--out {out}: exists already; results are never written over, name another"
        ) from None
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be created ({error.strerror}); name a folder that can"
        ) from error
    return out


def _run_direct(
    resolved: ResolvedScene,
    mover: Mover,
    run_id: str,
    out: Path,
    threads: int,
    progress: Callable[[int], None],
    stop_signal: Callable[[], int],
    resumed: Checkpoint | None,
) -> None:
    writer = BagWriter(out / "bag", resolved.scene, resolved.timing) if resolved.scene.record.bag else None
    sync = (writer.sync,) if writer is not None else ()
    try:
        soil = build_soil(resolved, threads)
        keeper = Keeper(out / CHECKPOINTS, resolved, run_id, *sync)
        controller = build_controller(resolved, resumed)
        run_direct(resolved, run_id, mover, soil, writer, progress, stop_signal, keeper, resumed, controller)
    finally:
        if writer is not None:
            writer.close()


def _run_composed(
    resolved: ResolvedScene,
    run_id: str,
    out: Path,
    threads: int,
    progress: Callable[[int], None],
    stop_signal: Callable[[], int],
    resumed: Checkpoint | None,
    paused: bool,
) -> None:
    with run_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        from ..nodes.composed import run_composed, scene_builds  # the other modes need no ROS here
        from ..nodes.lifeline import NodeRun

        node_run = NodeRun(run_id, resolved, out / CHECKPOINTS, resumed)
        builds = scene_builds(node_run, out / "bag", threads, progress, paused)
        _say_what_it_waits_for(resolved, run_id, domain, paused)
        ending = run_composed(node_run, builds, stop_signal)
    if ending.exit_status:
        raise ending.error()


def _run_nodes(
    resolved: ResolvedScene,
    run_id: str,
    out: Path,
    threads: int,
    progress: Callable[[int], None],
    stop_signal: Callable[[], int],
    resumed: Checkpoint | None,
    paused: bool,
) -> None:
    progress = announce_kernels_of_nodes(progress)
    logs = out / "log"
    logs.mkdir()
    parameters: Parameters = {
        "scene": str((out / "scene.yaml").resolve()),
        "run_id": run_id,
        "supervised": True,
        "checkpoints": str((out / CHECKPOINTS).resolve()),
        "resume": str(resumed.path.resolve()) if resumed is not None else "",
    }
    own: dict[str, Parameters] = {
        SOIL: {"threads": threads},
        RECORDER: {"bag": str((out / "bag").resolve())},
        COUPLER: {"paused": paused},
    }
    names = [*participants(resolved.scene), COUPLER]
    if CONTROLLER in names and build_controller(resolved) is None:
        names.remove(CONTROLLER)  # somebody else's
    with run_domain() as domain:
        _say_what_it_waits_for(resolved, run_id, domain, paused)
        processes = [
            start_node(
                name, node_program(name), logs / f"{name}.log", {**parameters, **own.get(name, {})}, domain
            )
            for name in names
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
            recover(bag)  # its writer may have been killed; a whole bag is left as it is
        mend_earlier(out)
        series = read_series(bag, resolved.scene)
        write_series_csv(series, out / "series.csv")
        summary = summarize(bag, resolved, run_info, series)
        write_summary(summary, out / "summary.json")
        print_summary(summary, resolved.scene, out)
    except SubsoilError:
        if failure is None:
            raise
    except OSError as error:
        if failure is None:
            raise RecordingError(f"{out}: the results cannot be written ({error.strerror})") from error
