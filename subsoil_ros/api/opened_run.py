"""A run that is ready to start: its scene checked, its bed prepared, its folder made."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..coupling.engines import MotionSource, Soil, build_motion_source, build_soil
from ..coupling.outside import Machine, OutsideSoil
from ..errors import InputError, SceneError
from ..loading.loader import ResolvedScene
from ..recording.checkpoint import Checkpoint
from .check import run_notes
from .checkpoints import CHECKPOINTS, find_checkpoint, note_resumption

if TYPE_CHECKING:
    from .beds import BedProgress


RUN_ID_DIGITS = 12
"""Hexadecimal digits of a run id: enough that scenes do not share one (48 bits), few enough to type."""


@dataclass(frozen=True)
class OpenedRun:
    """All that a run needs to start.

    out: its folder, with scene.yaml in it; motion_source: the mechanism, the paths or the machine from
    outside, None if that joins over DDS; resumed: where it goes on; warnings: why newer checkpoints than that
    are not used; soil: from outside, in this process.
    """

    resolved: ResolvedScene
    out: Path
    motion_source: MotionSource | None
    resumed: Checkpoint | None
    warnings: tuple[str, ...] = ()
    soil: Soil | None = None

    @property
    def run_id(self) -> str:
        """Name of the run: the first digits of the scene's hash, so that its bag is the same each time."""
        return self.resolved.scene_hash[:RUN_ID_DIGITS]

    @property
    def bag(self) -> Path:
        """Folder of its bag, which does not exist yet."""
        return self.out / "bag"

    @property
    def checkpoints(self) -> Path:
        """Folder of its checkpoints."""
        return self.out / CHECKPOINTS

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the scene that are printed before it runs."""
        return run_notes(self.resolved)


def open_run(
    resolved: ResolvedScene,
    out: Path,
    threads: int = 1,
    resume: Path | None = None,
    *,
    shown: str | None = None,
    bed_progress: "BedProgress | None" = None,
    machine: Machine | None = None,
    soil: OutsideSoil | None = None,
) -> OpenedRun:
    """Check that the scene can be run, prepare its bed, and make the folder `out`.

    Args:
        resume: folder of an earlier run of the scene, to go on from.
        shown: the scene as the user named it, for messages.
        machine, soil: from outside, in this process.
        bed_progress: shows the preparation of a bed that takes long.

    Raises:
        InputError: the scene cannot be run, or the folder exists or cannot be made; nothing was written.
    """
    resumed, warnings = (None, []) if resume is None else find_checkpoint(resume, resolved)
    try:
        joins = resolved.scene.external_machine and machine is None
        motion_source = None if joins else build_motion_source(resolved, machine)
        outside = build_soil(resolved, threads, soil) if soil is not None else None
        _prepare_soil(resolved, threads, bed_progress)
    except SceneError as error:
        raise SceneError(f"{shown or resolved.path}: {error}") from error
    _create_folder(out)
    resolved.write(out / "scene.yaml")
    if resumed is not None and resume is not None:
        note_resumption(resumed, resume, resolved, out)
    return OpenedRun(resolved, out, motion_source, resumed, tuple(warnings), outside)


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
