"""The frame of a run, in every mode: scene checked, bed prepared, folder made; then the run; then results."""

import shutil
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..analysis.summary import UnrecordedSummary
from ..analysis.versions import versions
from ..coupling.engines import MotionSource, Soil, build_motion_source, build_soil
from ..coupling.observer import RunObserver, RunWatch
from ..coupling.outside import Machine, OutsideSoil
from ..coupling.run_settings import RunSettings
from ..errors import InputError, SceneError, SubsoilError
from ..loading.loader import ResolvedScene
from .check import run_notes
from .checkpoints import CHECKPOINTS, checkpoint_facts, find_checkpoint, name_checkpoint, note_resumption
from .plausible import implausible
from .results import Reading, Working, write_results
from .simulate import simulate

if TYPE_CHECKING:
    from .beds import BedProgress


RUN_ID_DIGITS = 12
"""Hexadecimal digits of a run id: enough that scenes do not share one (48 bits), few enough to type."""


@dataclass(frozen=True)
class RunFrame:
    """A run in a folder of its own, from its start to its results.

    out: its folder, with scene.yaml in it; motion_source: the mechanism, the paths or the machine from
    outside, None if that joins over DDS; warnings: why newer checkpoints than the one it resumes from are
    not used; soil: from outside, in this process.
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
        facts |= {"stop_when": watch.stop_when} if watch.stop_when else {}
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
    soil: OutsideSoil | None = None,
) -> RunFrame:
    """Check that the scene can be run, prepare its bed, and make the folder `out`.

    Args:
        settings: run_id, bag, checkpoints and resumed are set here.
        resume: folder of an earlier run of the scene, to go on from.
        shown: the scene as the user named it, for messages.
        machine, soil: from outside, in this process.
        bed_progress: shows the preparation of a bed that takes long.

    Raises:
        InputError: the scene cannot be run, or the folder exists or cannot be made; nothing was written.
    """
    resolved = settings.resolved
    resumed, warnings = (None, []) if resume is None else find_checkpoint(resume, resolved)
    try:
        joins = resolved.scene.external_machine and machine is None
        motion_source = None if joins else build_motion_source(resolved, machine)
        outside = build_soil(resolved, settings.threads, soil) if soil is not None else None
        warnings += implausible(resolved)
        _prepare_soil(resolved, settings.threads, bed_progress)
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
    frame = RunFrame(settings, out, motion_source, tuple(warnings), outside)
    resolved.write(frame.scene)
    if resumed is not None and resume is not None:
        note_resumption(resumed, resume, resolved, out)
    return frame


def run_id_of(resolved: ResolvedScene) -> str:
    """Name of a run: the first digits of the scene's hash, so that its bag is the same each time."""
    return resolved.scene_hash[:RUN_ID_DIGITS]


def _prepare_soil(resolved: ResolvedScene, threads: int, progress: "BedProgress | None") -> None:
    if resolved.scene.particle_soil is None:
        return  # without particles none of their code is imported
    from ..dem.beds.start import check_start
    from .beds import prepare_bed_first

    if resolved.scene.particle_soil.device == "gpu":
        from ..dem.gpu.device import refuse_without_gpu

        refuse_without_gpu()
    check_start(resolved)
    prepare_bed_first(resolved, threads, progress)


def _create_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        raise InputError(f"{out}: exists already; results are never written over, name another") from None
    except OSError as error:
        raise InputError(f"{out}: cannot be created ({error.strerror}); name a folder that can") from error
