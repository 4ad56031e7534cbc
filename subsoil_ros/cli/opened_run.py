"""A run that can begin: its scene checked, its bed prepared, its folder made."""

import uuid
from dataclasses import dataclass
from pathlib import Path

from ..coupling.engines import Mover, build_mechanism, build_paths
from ..errors import InputError, SceneError
from ..nodes.plan import RunPlan
from ..recording.checkpoint import Checkpoint
from ..scene.limits import step_notes
from ..scene.loader import ResolvedScene
from .resumption import CHECKPOINTS, find_checkpoint, note_resumption


@dataclass(frozen=True)
class OpenedRun:
    """What a run needs to begin.

    out: its folder, with scene.yaml in it; mover: the mechanism or the paths; resumed: where it goes on.
    """

    resolved: ResolvedScene
    out: Path
    run_id: str
    mover: Mover
    resumed: Checkpoint | None

    def plan(
        self,
        threads: int,
        paused: bool = False,
        supervised: bool = False,
        recorded: bool = True,
        live: int = 0,
    ) -> RunPlan:
        """The processes of the run."""
        return RunPlan(
            self.resolved,
            scene=self.out / "scene.yaml",
            run_id=self.run_id,
            bag=self.out / "bag",
            checkpoints=self.out / CHECKPOINTS,
            resume=self.resumed.path if self.resumed is not None else None,
            threads=threads,
            paused=paused,
            live=live,
            recorded=recorded,
            supervised=supervised,
        )


def open_run(
    resolved: ResolvedScene, shown: str, out: Path, threads: int, resume: Path | None = None
) -> OpenedRun:
    """Looks whether the scene can be run, prepares its bed, and makes the folder `out`.

    shown: the scene as the user named it; resume: folder of an earlier run of it, to go on from.

    Raises:
        InputError: it cannot, or the folder exists or cannot be made; nothing was written.
    """
    resumed = find_checkpoint(resume, resolved) if resume is not None else None
    try:
        mover = build_mechanism(resolved) or build_paths(resolved)
        _prepare_bed(resolved, threads)
    except SceneError as error:
        raise SceneError(f"{shown}: {error}") from error
    _create_folder(out)
    resolved.write(out / "scene.yaml")
    if resumed is not None and resume is not None:
        note_resumption(resumed, resume, resolved, out)
    for note in _notes(resolved):
        print(note, flush=True)
    return OpenedRun(resolved, out, uuid.uuid4().hex[:12], mover, resumed)


def _prepare_bed(resolved: ResolvedScene, threads: int) -> None:
    if resolved.scene.particle_soil is None:
        return  # without particles none of their code is imported
    from ..dem.beds.prepare import check_start
    from .bed_preparation import prepare_bed_first

    if resolved.scene.particle_soil.device == "gpu":
        from ..dem.gpu.device import refuse_without_gpu

        refuse_without_gpu()
    check_start(resolved)
    prepare_bed_first(resolved, threads)


def _notes(resolved: ResolvedScene) -> tuple[str, ...]:
    if resolved.scene.particle_soil is None:
        return resolved.notes
    return (*resolved.notes, *step_notes(resolved.scene, resolved.timing.soil_step_s))


def _create_folder(out: Path) -> None:
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
