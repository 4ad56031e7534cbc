"""Work of a Dask worker: one run, in its own process."""

import signal
import tempfile
import time
from pathlib import Path

from ...api.execution import RunResult, execute
from ...loading.scene_bundle import SceneBundle, unpack

PROGRESS = "subsoil-progress"
"""Dask's topic for (name of the run, part of it that is done)."""

TELL_EVERY_S = 0.5
"""Wall time between two messages of progress: frequent enough for a bar, with little traffic."""


def run_bundle(name: str, bundle: SceneBundle, threads: int, at_once: int, warm_up: bool) -> RunResult:
    """Run a scene received as a bundle. Raises SceneError if its hash is not that of the scene sent."""
    from distributed import get_worker

    worker = get_worker()
    told = 0.0
    with tempfile.TemporaryDirectory(prefix="subsoil-bundle-") as folder:
        scene = unpack(bundle, Path(folder))
        count = scene.timing.tick_count

        def on_tick(tick: int) -> None:
            nonlocal told
            now = time.monotonic()
            if now - told > TELL_EVERY_S or tick == count - 1:
                told = now
                worker.log_event(PROGRESS, {"name": name, "part": (tick + 1) / count})

        return execute(scene, threads, on_tick, at_once=at_once, warm_up=warm_up)


def ignore_interrupts() -> None:
    """Ignore Ctrl-C, which a terminal sends to all processes; the process of the sweep ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
