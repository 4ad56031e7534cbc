"""subsoil run SCENE --out DIR: simulates a scene and leaves a bag, a series and a summary."""

import argparse
import os
import shutil
import time
import uuid
from collections.abc import Callable
from pathlib import Path

from ..analysis.series import read_series, write_series_csv
from ..analysis.summary import print_summary, summarize, write_summary
from ..coupling.direct import run_direct
from ..coupling.engines import Mover, build_mechanism, build_paths, build_soil
from ..coupling.protocol import COUPLER, RECORDER, SOIL, participants
from ..dem.beds.prepare import check_start
from ..errors import InputError, RecordingError, SceneError, SubsoilError
from ..nodes.domain import run_domain
from ..nodes.signals import caught_signals
from ..recording.bag_writer import BagWriter
from ..recording.recovery import recover
from ..scene.limits import step_notes
from ..scene.loader import ResolvedScene, load_scene
from .arguments import add_overrides
from .preparation import KernelAnnouncer, announce_kernels_of_nodes, prepare_bed_first
from .progress import RunProgress
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
    try:
        mover = build_mechanism(resolved) or build_paths(resolved)
        check_start(resolved)
        prepare_bed_first(resolved, args.threads)
    except SceneError as error:
        raise SceneError(f"{args.scene}: {error}") from error
    out = _create_folder(Path(args.out))
    resolved.write(out / "scene.yaml")
    run_id = uuid.uuid4().hex[:12]
    if resolved.scene.soil is not None:
        for note in step_notes(resolved.scene.soil, resolved.timing.soil_step_s):
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
                _run_direct(resolved, mover, run_id, out, args.threads, progress, stop_signal)
            elif args.mode == "composed":
                _run_composed(resolved, run_id, out, args.threads, progress, stop_signal)
            else:
                _run_nodes(resolved, run_id, out, args.threads, progress, stop_signal)
    except SubsoilError as error:
        failure = error
    if failure is not None and failure.exit_status == InputError.exit_status and not bar.started:
        shutil.rmtree(out)  # bad input that showed only when the bed was there: nothing ran
        raise failure
    wall_s = time.monotonic() - start
    _summarize(resolved, out, {"mode": args.mode, "threads": args.threads, "whole_wall_s": wall_s}, failure)
    if failure is not None:
        raise failure
    return 0


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
) -> None:
    writer = BagWriter(out / "bag", resolved.scene, resolved.timing)
    try:
        soil = build_soil(resolved, threads)
        run_direct(resolved, run_id, mover, soil, writer, progress, stop_signal)
    finally:
        writer.close()


def _run_composed(
    resolved: ResolvedScene,
    run_id: str,
    out: Path,
    threads: int,
    progress: Callable[[int], None],
    stop_signal: Callable[[], int],
) -> None:
    with run_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        from ..nodes.composed import run_composed, scene_builds  # the other modes need no ROS here
        from ..nodes.lifeline import NodeRun

        node_run = NodeRun(run_id, resolved)
        ending = run_composed(node_run, scene_builds(node_run, out / "bag", threads, progress), stop_signal)
    if ending.exit_status:
        raise ending.error()


def _run_nodes(
    resolved: ResolvedScene,
    run_id: str,
    out: Path,
    threads: int,
    progress: Callable[[int], None],
    stop_signal: Callable[[], int],
) -> None:
    progress = announce_kernels_of_nodes(progress)
    logs = out / "log"
    logs.mkdir()
    parameters: Parameters = {
        "scene": str((out / "scene.yaml").resolve()),
        "run_id": run_id,
        "supervised": True,
    }
    own: dict[str, Parameters] = {
        SOIL: {"threads": threads},
        RECORDER: {"bag": str((out / "bag").resolve())},
    }
    with run_domain() as domain:
        processes = [
            start_node(
                name, node_program(name), logs / f"{name}.log", {**parameters, **own.get(name, {})}, domain
            )
            for name in (*participants(resolved.scene), COUPLER)
        ]
        ending = Supervisor(processes, progress).follow(stop_signal)
    if ending.exit_status:
        raise ending.error()


def _summarize(
    resolved: ResolvedScene, out: Path, run_info: dict[str, object], failure: SubsoilError | None
) -> None:
    """Makes series and summary from the bag; of a run that failed, if there is anything to show."""
    bag = out / "bag"
    try:
        if failure is not None:
            recover(bag)  # its writer may have been killed; a whole bag is left as it is
            run_info = run_info | {"failure": str(failure)}
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
