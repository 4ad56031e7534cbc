"""Run a scene in this process and read the result."""

import signal
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path

from ..coupling.exit_status import counted_interrupts
from ..coupling.external import ExternalSoil, Machine, refuse_unlike
from ..coupling.observer import RunWatch
from ..coupling.run_settings import RunSettings
from ..errors import InputError
from ..loading.loader import ResolvedScene
from .load import SceneLike, resolved_scene
from .read import Run, read_run
from .run_frame import RunFrame, needed_controller, open_run

Progress = Callable[[int, int], None]
"""Called with (ticks done, ticks of the run) after every tick."""


def run(
    scene: SceneLike | ResolvedScene,
    out: str | PathLike[str] | None = None,
    *,
    overrides: Mapping[str, object] | None = None,
    threads: int = 1,
    resume: str | PathLike[str] | None = None,
    progress: Progress | None = None,
    machine: Machine | None = None,
    soil: ExternalSoil | None = None,
) -> Run:
    """Run a scene without ROS, as `subsoil run --mode direct` does: the same files, the same bits.

    Ctrl-C ends the run after the current tick. In a thread other than the main one, where no signal arrives,
    raise KeyboardInterrupt in `progress`: it ends the run in the same way.

    Args:
        scene: as load_scene takes it, or gives it.
        out: folder for the results, which must not exist. None: nothing is left on the disk.
        overrides: as in load_scene.
        threads: of the soil engine; the results do not depend on it.
        resume: folder of an earlier run of the scene, to go on from its newest checkpoint.
        progress: called with the number of ticks done and the number of all, after every tick.
        machine: moves the tools of a scene with path.external: true (docs/own_machine.md).
        soil: answers the tools of a scene with soil.model: external.

    Returns:
        The run, as read_run gives it.

    Raises:
        SceneError, InputError: the scene, or another argument, cannot be used; nothing was written.
        InterruptedRunError: the run was interrupted. In `out` there are a readable bag, the results so far
            and a checkpoint, which the message names.
        RunError: the run failed; what was recorded before is in `out`.
    """
    if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
        raise InputError(f"threads: given {threads!r}; it must be a whole number of 1 or more")
    resolved = resolved_scene(scene, overrides)
    needed_controller(resolved)
    refuse_unlike(resolved, machine, soil)
    earlier = Path(resume) if resume is not None else None
    settings = RunSettings(resolved, threads=threads)
    if out is not None:
        frame = open_run(settings, Path(out), earlier, machine=machine, soil=soil)
        _complete(frame, progress)
        return replace(read_run(frame.out), scene=resolved)
    with tempfile.TemporaryDirectory(prefix="subsoil-run-") as folder:
        frame = open_run(settings, Path(folder) / "run", earlier, machine=machine, soil=soil)
        _complete(frame, progress, lasting=False)
        found = read_run(frame.out)
        found.summary["run"].pop("checkpoint", None)  # removed with the folder
        return replace(found, scene=resolved, folder=None)


def _complete(frame: RunFrame, progress: Progress | None, *, lasting: bool = True) -> None:
    """Run into the folder and write the results. Raises what the run raises."""
    watch, tick_count = RunWatch(), frame.settings.resolved.timing.tick_count

    def show(tick: int) -> None:
        if progress is not None:
            try:
                progress(tick + 1, tick_count)
            except KeyboardInterrupt:
                watch.signals.append(signal.SIGINT)

    watch.show = show
    with counted_interrupts(watch.signals):
        _, failure = frame.complete("direct", lambda: frame.simulate(watch), watch, lasting=lasting)
    if failure is not None:
        raise failure
    if watch.signals:
        raise KeyboardInterrupt  # it came when the last tick was done; the results are whole
