"""The frame of a run, in every mode: scene checked, bed prepared, folder made; then the run; then results.

`simulate` is the one wiring of engines, controller, bag and loop for a run without ROS.
"""

import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..analysis.known_mean import build_stop_rule
from ..analysis.series import read_series, write_series_csv
from ..analysis.summarize import summarize, summarize_unrecorded, versions
from ..analysis.summary import UnrecordedSummary
from ..coupling.control import Controller, build_controller
from ..coupling.direct import RecordSink, run_direct
from ..coupling.engines import Engines, MotionSource, Soil, build_motion_source, build_soil
from ..coupling.external import ExternalSoil, Machine
from ..coupling.observer import RunObserver, RunWatch
from ..coupling.run_settings import RunSettings
from ..errors import InputError, RecordingError, SceneError, SubsoilError
from ..extras import require
from ..limits.stable_steps import Timing
from ..loading.loader import ResolvedScene
from ..messages import RunRecord
from ..recording.bag_writer import open_bag
from ..recording.checkpoint import Checkpoint
from ..recording.joined import recover_earlier
from ..recording.recovery import recover
from ..yaml_document import Document
from .check_scene import run_notes
from .plausible import implausible
from .resume import CHECKPOINTS, checkpoint_facts, find_checkpoint, name_checkpoint, note_resumption

if TYPE_CHECKING:
    from .prepare_bed import BedProgress


def needed_controller(resolved: ResolvedScene, resumed: Checkpoint | None = None) -> Controller | None:
    """The scene's controller; None if it names none.

    Raises:
        InputError: the controller is an external node, which needs a mode with nodes.
    """
    controller = build_controller(resolved, resumed)
    if resolved.scene.controller is not None and controller is None:
        raise InputError(
            f"{resolved.path}: controller.law: 'external' is a node of its own, and a direct run has no "
            "nodes; use `subsoil run --mode nodes` or composed, another law, or no controller"
        )
    return controller


def simulate(
    settings: RunSettings,
    *,
    motion_source: MotionSource | None = None,
    soil: Soil | None = None,
    controller: Controller | None = None,
    sink: RecordSink | None = None,
    observer: RunObserver | None = None,
) -> None:
    """Run a scene in this process, from tick 0 or a checkpoint to its last tick.

    Args:
        settings: the bag is closed whatever happens.
        motion_source, soil, controller: replace those of the scene.
        sink: takes the records, after the bag if there is one.
        observer: receives each tick and each check, and may end the run.

    Raises:
        InputError: as open_bag, or the scene needs an external controller.
        InterruptedRunError: the observer ended the run.
        RunError: an engine or the interface account failed. Every finished tick is recorded.
    """
    resolved, resumed = settings.resolved, settings.resumed
    controller = controller or needed_controller(resolved, resumed)
    writer = open_bag(settings.bag, resolved, settings.live_port) if settings.bag is not None else None
    try:
        engines = Engines(
            resolved.scene,
            motion_source or build_motion_source(resolved),
            soil or build_soil(resolved, settings.threads),
            controller,
        )
        checkpoint_writer = None
        if settings.checkpoints is not None and engines.keeps_state:
            checkpoint_writer = settings.checkpoint_writer(*(() if writer is None else (writer.sync,)))
        run_direct(
            settings,
            engines,
            _Both(writer, sink) if writer is not None and sink is not None else writer or sink,
            observer,
            stop_rule=build_stop_rule(resolved, resumed),
            checkpoint_writer=checkpoint_writer,
        )
    finally:
        if writer is not None:
            writer.close()


@dataclass(frozen=True)
class _Both:
    """Passes records on to two sinks."""

    first: RecordSink
    second: RecordSink

    def write(self, record: RunRecord) -> None:
        self.first.write(record)
        self.second.write(record)


Reading = Callable[[Timing], AbstractContextManager[Callable[[int], None]]]
"""Shows that a bag is being read; yields a callback that takes the time [ns] of each message."""

Working = Callable[[str], AbstractContextManager[object]]
"""Shows that work of this name is in progress."""


def write_results(
    resolved: ResolvedScene,
    out: Path,
    run_info: Document,
    failure: SubsoilError | None = None,
    *,
    reading: Reading = lambda timing: nullcontext(lambda time_ns: None),
    working: Working = nullcontext,
) -> UnrecordedSummary | None:
    """Write series.csv and summary.json into the folder `out` of a run, from its bag.

    run_info: facts that are not in the bag, fields of summary.RunFacts.

    Returns:
        The summary, of a recorded run a summary.Summary; None if the run failed before anything was recorded.

    Raises:
        RecordingError: the bag of a run that did not fail cannot be read, or the results not be written.
    """
    bag = out / "bag"
    if failure is not None:
        run_info = run_info | {"failure": str(failure)}
    try:
        if not resolved.scene.record.bag and not bag.is_dir():
            unrecorded = summarize_unrecorded(resolved, run_info)
            unrecorded.write(out / "summary.json")
            return unrecorded
        if failure is not None:
            with working("looking after the bag"):
                recover(bag)  # its writer may have been killed; a whole bag is left as it is
        recover_earlier(out)
        with reading(resolved.timing) as on_time:
            series = read_series(bag, resolved.scene, on_time)
        write_series_csv(series, out / "series.csv")
        with working("reading the clouds"):
            summary = summarize(bag, resolved, run_info, series)
        summary.write(out / "summary.json")
        return summary
    except SubsoilError:
        if failure is None:
            raise
    except OSError as error:
        if failure is None:
            raise RecordingError(f"{out}: the results cannot be written ({error.strerror})") from error
    return None


RUN_ID_DIGITS = 12
"""Hexadecimal digits of a run id: enough that scenes do not share one (48 bits), few enough to type."""


@dataclass(frozen=True)
class RunFrame:
    """A run in a folder of its own, from its start to its results.

    out: its folder, with scene.yaml in it; motion_source: the mechanism, the paths or the external
    machine, None if that joins over DDS; warnings: why newer checkpoints than the one it resumes from are
    not used; soil: external, in this process.
    """

    settings: RunSettings
    out: Path
    motion_source: MotionSource | None
    warnings: tuple[str, ...] = ()
    soil: Soil | None = None

    @property
    def scene(self) -> Path:
        """The scene file as run."""
        return self.out / "scene.yaml"

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the scene that are printed before it runs."""
        return run_notes(self.settings.resolved)

    def simulate(self, observer: RunObserver) -> None:
        """Run in this process without ROS. Raises as simulate."""
        simulate(self.settings, motion_source=self.motion_source, soil=self.soil, observer=observer)

    def complete(
        self,
        mode: str,
        work: Callable[[], None],
        watch: RunWatch,
        *,
        lasting: bool = True,
        reading: Reading = lambda timing: nullcontext(lambda time_ns: None),
        working: Working = nullcontext,
    ) -> tuple[UnrecordedSummary | None, SubsoilError | None]:
        """Do the work of the run, and write series.csv and summary.json, also of a run that fails.

        Args:
            work: runs the scene, observed by `watch`.
            lasting: the folder is kept, so the message of a failure names its newest checkpoint.

        Returns:
            The summary, None if the run failed before anything was recorded; and the failure, if it failed.

        Raises:
            InputError: bad input that shows only when the engines are built; the folder is removed.
            RecordingError: as write_results.
        """
        settings, failure, start = self.settings, None, time.monotonic()
        try:
            work()
        except SubsoilError as error:
            failure = error
        if failure is not None and failure.exit_status == InputError.exit_status and not watch.started:
            shutil.rmtree(self.out)
            raise failure
        if failure is not None and lasting:
            name_checkpoint(failure, self.out, settings.resumed)
        facts = {"mode": mode, "threads": settings.threads, "whole_wall_s": time.monotonic() - start}
        if settings.resolved.material is not None:
            facts["soil"] = settings.resolved.material.soil.name
        facts |= {"stop_when": watch.stop_when} if watch.stop_when else {}
        facts |= {"followed": watch.followed} if watch.followed else {}
        facts |= {"versions": versions()} | checkpoint_facts(self.out, settings.resumed)
        summary = write_results(settings.resolved, self.out, facts, failure, reading=reading, working=working)
        return summary, failure


def open_run(
    settings: RunSettings,
    out: Path,
    resume: Path | None = None,
    *,
    shown: str | None = None,
    bed_progress: "BedProgress | None" = None,
    machine: Machine | None = None,
    soil: ExternalSoil | None = None,
) -> RunFrame:
    """Check that the scene can be run, prepare its bed, and make the folder `out`.

    Args:
        settings: run_id, bag, checkpoints and resumed are set here.
        resume: folder of an earlier run of the scene, to go on from.
        shown: the scene as the user named it, for messages.
        machine, soil: external, in this process.
        bed_progress: shows the preparation of a bed that takes long.

    Raises:
        InputError: the scene cannot be run, or the folder exists or cannot be made; nothing was written.
    """
    resolved = settings.resolved
    _refuse_existing(out)  # before what takes long
    resumed, warnings = (None, []) if resume is None else find_checkpoint(resume, resolved)
    try:
        joins = resolved.scene.external_machine and machine is None
        motion_source = None if joins else build_motion_source(resolved, machine)
        external = build_soil(resolved, settings.threads, soil) if soil is not None else None
        _refuse_start(resolved, settings.ranks)
        warnings += implausible(resolved)
        _prepare_bed(resolved, settings.threads, bed_progress)
    except SceneError as error:
        raise SceneError(f"{shown or resolved.path}: {error}") from error
    _create_folder(out)
    settings = replace(
        settings,
        run_id=run_id_of(resolved),
        bag=out / "bag" if resolved.scene.record.bag else None,
        checkpoints=out / CHECKPOINTS,
        resumed=resumed,
    )
    frame = RunFrame(settings, out, motion_source, tuple(warnings), external)
    resolved.write(frame.scene)
    if resumed is not None and resume is not None:
        note_resumption(resumed, resume, resolved, out)
    return frame


def run_id_of(resolved: ResolvedScene) -> str:
    """Name of a run: the first digits of the scene's hash, so that its bag is the same each time."""
    return resolved.scene_hash[:RUN_ID_DIGITS]


def _refuse_start(resolved: ResolvedScene, ranks: int) -> None:
    """Check what particles would start from; without them none of their code is imported."""
    soil = resolved.scene.particle_soil
    if ranks > 1 and (soil is None or soil.engine != "lammps"):
        raise InputError(
            f"--ranks: given {ranks}, but only soil.engine: 'lammps' has ranks; the soil here has --threads"
        )
    if soil is None:
        return
    from ..dem.packing.start import check_start

    if soil.engine == "lammps":
        require("soil.engine: 'lammps'", "lammps", "mpi4py")
    if soil.device == "gpu":
        from ..dem.gpu.device import refuse_without_gpu

        refuse_without_gpu()
    check_start(resolved)


def _prepare_bed(resolved: ResolvedScene, threads: int, progress: "BedProgress | None") -> None:
    if resolved.scene.particle_soil is not None:
        from .prepare_bed import prepare_bed_first

        prepare_bed_first(resolved, threads, progress)


def _refuse_existing(out: Path) -> None:
    if out.exists():
        raise InputError(f"{out}: exists already; results are never written over, name another")


def _create_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        _refuse_existing(out)
        raise
    except OSError as error:
        raise InputError(f"{out}: cannot be created ({error.strerror}); name a folder that can") from error
