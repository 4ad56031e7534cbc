"""Run a scene in this process and read the result."""

import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from ..coupling.outside import Machine, OutsideSoil, refuse_unlike
from ..errors import InputError, SubsoilError
from ..loading.loader import ResolvedScene
from .checkpoints import name_checkpoint
from .load import SceneLike, resolved_scene
from .opened_run import OpenedRun, open_run
from .read import Run, read_run
from .results import conclude
from .simulate import needed_controller, simulate_opened

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
    soil: OutsideSoil | None = None,
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
    if out is not None:
        opened = open_run(resolved, Path(out), threads, earlier, machine=machine, soil=soil)
        _run(opened, threads, progress)
        return replace(read_run(opened.out), scene=resolved)
    with tempfile.TemporaryDirectory(prefix="subsoil-run-") as folder:
        place = Path(folder) / "run"
        opened = open_run(resolved, place, threads, earlier, machine=machine, soil=soil)
        _run(opened, threads, progress, lasting=False)
        found = read_run(opened.out)
        found.summary["run"].pop("checkpoint", None)  # removed with the folder
        return replace(found, scene=resolved, folder=None)


def _run(opened: OpenedRun, threads: int, progress: Progress | None, *, lasting: bool = True) -> None:
    """Run into the folder and write the results. Raises what the run raises.

    lasting: the folder is kept, so the message of a failure names its newest checkpoint.
    """
    failure: SubsoilError | None = None
    stopped: list[int] = []  # signals
    tick_count = opened.resolved.timing.tick_count
    started = False
    found: dict[str, Any] = {}  # of the mean of stop_when

    def on_tick(tick: int) -> None:
        nonlocal started
        started = True
        if progress is not None:
            try:
                progress(tick + 1, tick_count)
            except KeyboardInterrupt:
                stopped.append(signal.SIGINT)

    start = time.monotonic()
    with _interrupts(stopped):
        try:
            simulate_opened(
                opened, threads, on_tick, lambda: stopped[0] if stopped else 0, on_check=found.update
            )
        except SubsoilError as error:
            failure = error
            if lasting:
                name_checkpoint(failure, opened.out, opened.resumed)
        if isinstance(failure, InputError) and not started:
            shutil.rmtree(opened.out)  # bad input that showed only when the engines were built
        else:
            facts = {"mode": "direct", "threads": threads, "whole_wall_s": time.monotonic() - start}
            facts |= {"stop_when": found} if found else {}
            conclude(opened, facts, failure)
    if failure is not None:
        raise failure
    if stopped:
        raise KeyboardInterrupt  # it came when the last tick was done; the results are whole


@contextmanager
def _interrupts(stopped: list[int]) -> Iterator[None]:
    """Context in which Ctrl-C appends its signal to `stopped`; without effect outside of the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, lambda number, _: stopped.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
