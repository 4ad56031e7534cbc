"""Runs the jobs of a sweep or a study, each once, and keeps their results."""

import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from ...api.execution import RunResult, code_digest, machine_name
from ...errors import RunError
from ...loading.scene_bundle import pack
from ...yaml_document import Document
from ..run_cache import CachedRun, find_run, keep_run
from .cluster import PROGRESS, connected, local_worker_count, run_bundle
from .points import Job

if TYPE_CHECKING:
    from distributed import Client, Future


class Watcher(Protocol):
    """Receiver of the progress of runs."""

    def begin(self, kept: int, count: int) -> None:
        """Start: `kept` of `count` runs are in the cache already."""
        ...

    def went_on(self, name: str, part: float) -> None:
        """Update: a run has done this part of its ticks."""
        ...

    def ended(self, name: str, failure: str | None) -> None:
        """End of a run: its result is kept."""
        ...


@dataclass(frozen=True)
class ExecutionOptions:
    """Options of the execution of jobs."""

    scheduler: str | None = None  # address of a Dask cluster; None: this machine
    workers: int | None = None  # runs at once on this machine; None: as many as its cores allow
    threads: int = 1  # of the soil engine
    retry_failed: bool = False
    timed: bool = False  # for timings: warm up first, use no kept run that had more company


def run_jobs(jobs: Sequence[Job], cache: Path, manner: ExecutionOptions, watcher: Watcher) -> list[CachedRun]:
    """Return the cached run of every job, in order. A failed run is kept with its message; the others go on.

    If the call is interrupted, by Ctrl-C say, finished runs are kept, and the next call continues from there.

    Raises:
        InputError: as connected.
        RunError: the scheduler went away.
    """
    wanted = {job.scene.scene_hash: job for job in jobs}  # equal scenes run once
    missing = {
        scene_hash: job
        for scene_hash, job in wanted.items()
        if _is_missing(find_run(cache, scene_hash), manner)
    }
    watcher.begin(len(wanted) - len(missing), len(wanted))
    if missing:
        _run_missing(missing, cache, manner, watcher)
    found = [find_run(cache, job.scene.scene_hash) for job in jobs]
    return [run for run in found if run is not None]


def _is_missing(kept: CachedRun | None, manner: ExecutionOptions) -> bool:
    if kept is None:
        return True
    if kept.failure is not None:
        return manner.retry_failed
    if not manner.timed:
        return False
    had_company = kept.facts["at_once"] > (manner.workers or 1) or kept.facts["threads"] != manner.threads
    return had_company or kept.facts["cpu_s"] is None


def _run_missing(missing: dict[str, Job], cache: Path, manner: ExecutionOptions, watcher: Watcher) -> None:
    """Run as many at once as there are workers: a run queued on a worker would fail if that worker died."""
    from distributed import as_completed

    workers = min(manner.workers or local_worker_count(manner.threads), len(missing))
    with connected(manner.scheduler, workers) as (client, at_once), _told(client, watcher.went_on):
        names = _names(missing)
        waiting = list(reversed(missing))
        running = as_completed()
        hashes: dict[object, str] = {}  # by key of the future

        def submit() -> None:
            while waiting and len(hashes) < max(1, sum(client.nthreads().values())):
                scene_hash = waiting.pop()
                future = client.submit(
                    run_bundle, names[scene_hash], pack(missing[scene_hash].scene), manner.threads, at_once,
                    manner.timed, key=f"subsoil-{uuid.uuid4().hex}", pure=False, retries=0,
                )  # fmt: skip
                hashes[future.key] = scene_hash
                running.add(future)

        submit()
        for future in running:
            scene_hash = hashes.pop(future.key)
            kept = keep_run(cache, missing[scene_hash].scene, _executed(future, manner, at_once))
            watcher.ended(names[scene_hash], kept.failure)
            submit()


def _names(missing: dict[str, Job]) -> dict[str, str]:
    """Labels by hash, made different where two are equal."""
    return {scene_hash: f"{job.point.label} ({scene_hash[:6]})" for scene_hash, job in missing.items()}


def _executed(future: "Future", manner: ExecutionOptions, at_once: int) -> RunResult:
    """Result of a future; an error outside of the run, such as a killed worker, becomes a failed run."""
    if future.cancelled():
        raise RunError("the Dask scheduler has gone; what was finished is kept, the same call goes on")
    error = future.exception()
    if error is None:
        result: RunResult = future.result()
        return result
    from distributed import KilledWorker

    words = f"{type(error).__name__}: {' '.join(str(error).split())}"
    if isinstance(error, KilledWorker):
        words = f"the worker process that ran it died, {error.last_worker.address}: out of memory, or killed"
    facts: Document = {
        "failure": words,
        "exit_status": getattr(error, "exit_status", 3),
        "wall_s": None,
        "cpu_s": None,
        "whole_wall_s": None,
        "threads": manner.threads,
        "at_once": at_once,
        "machine": machine_name(),
        "code": code_digest(),
    }
    return RunResult({}, facts)


@contextmanager
def _told(client: "Client", went_on: Callable[[str, float], None]) -> Iterator[None]:
    """Context in which `went_on` is called with the progress that the workers report."""
    client.subscribe_topic(PROGRESS, lambda event: went_on(event[1]["name"], event[1]["part"]))
    try:
        yield
    finally:
        client.unsubscribe_topic(PROGRESS)
