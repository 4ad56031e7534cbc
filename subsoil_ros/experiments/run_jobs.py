"""Runs the jobs of a sweep or a study, each once, on workers of this machine or of a Dask cluster."""

import logging
import os
import signal
import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol
from urllib.parse import urlsplit

from ..api.execution import RunResult, code_digest, execute, machine_name
from ..coupling.exit_status import counted_interrupts
from ..errors import InputError, RunError
from ..loading.scene_bundle import SceneBundle, pack, unpack
from .run_cache import CachedRun, find_run, keep_run, warn_of_other_code
from .sweep_points import Job

if TYPE_CHECKING:
    from distributed import Client, Future

PATIENCE_S = 20.0
"""Longest wall time to wait for an answer of the scheduler and for its first worker; a wrong address is
reported after this time."""

PROGRESS = "subsoil-progress"
"""Dask's topic for (name of the run, part of it that is done)."""

TELL_EVERY_S = 0.5
"""Wall time between two messages of progress: frequent enough for a bar, with little traffic."""


class Watcher(Protocol):
    """Receiver of the progress of runs."""

    def begin(self, kept: int, count: int) -> None:
        """Start: `kept` of `count` runs are in the cache already."""

    def went_on(self, name: str, part: float) -> None:
        """Update: a run has done this part of its ticks."""

    def ended(self, name: str, failure: str | None) -> None:
        """End of a run: its result is kept."""


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
    kept = {scene_hash: find_run(cache, scene_hash) for scene_hash in wanted}
    missing = {key: job for key, job in wanted.items() if _is_missing(kept[key], manner)}
    warn_of_other_code(run for key, run in kept.items() if run is not None and key not in missing)
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
        names = {key: f"{job.point.label} ({key[:6]})" for key, job in missing.items()}  # all different
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
    facts: dict[str, object] = {
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


def local_worker_count(threads: int) -> int:
    """How many runs of `threads` threads this machine takes at once."""
    return max(1, len(os.sched_getaffinity(0)) // threads)


@contextmanager
def connected(scheduler: str | None, workers: int) -> Iterator["tuple[Client, int]"]:
    """A Dask client, and how many runs go at once on a machine.

    scheduler: its address; None: a cluster of `workers` processes on this machine, gone at the end.

    Raises:
        InputError: no scheduler answers there, it has no worker, or one runs other engines than this process.
    """
    import dask
    from distributed import Client

    settings = {
        "distributed.scheduler.allowed-failures": 0,  # a run whose worker dies fails at once
        "distributed.comm.timeouts.connect": f"{PATIENCE_S}s",
    }
    with dask.config.set(settings):
        if scheduler is None:
            with _local_client(workers) as client:
                yield client, workers
            return
        try:
            client = Client(scheduler, timeout=PATIENCE_S)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: no Dask scheduler answers there ({error}); start one with `dask "
                "scheduler`, and `dask worker ADDRESS` in an environment with subsoil_ros"
            ) from error
        with client:
            _look_over(client, scheduler)
            hosts = Counter(urlsplit(worker).hostname for worker in client.nthreads())
            yield client, max(hosts.values())


@contextmanager
def _local_client(workers: int) -> Iterator["Client"]:
    """Client of a cluster on this machine. Ctrl-C waits until it is there: half of one cannot be closed."""
    from distributed import Client, LocalCluster

    stopped: list[int] = []
    with ExitStack() as opened:
        folder = opened.enter_context(tempfile.TemporaryDirectory(prefix="subsoil-dask-"))
        with counted_interrupts(stopped):
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                memory_limit=None,  # a run cannot be moved to the disk; the system's own limit counts
                local_directory=folder,
                silence_logs=logging.CRITICAL,
            )
            client = opened.enter_context(Client(opened.enter_context(cluster)))
            client.run(ignore_interrupts)  # in the main thread of each
        if stopped:
            raise KeyboardInterrupt
        yield client


def _look_over(client: "Client", scheduler: str) -> None:
    """Raise InputError if the cluster has no worker, or one with other engines."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError as error:
        raise InputError(
            f"--scheduler {scheduler}: has no worker; start some with `dask worker {scheduler} --nthreads 1` "
            "in an environment with subsoil_ros"
        ) from error
    for worker, answer in client.run(code_digest, on_error="return").items():
        if answer != code_digest():
            what = f"has engines {answer}" if isinstance(answer, str) else f"answers {answer!r}"
            raise InputError(
                f"--scheduler {scheduler}: worker {worker} {what}, this machine {code_digest()}; runs of "
                "different engines are not one sweep: install the same subsoil_ros there"
            )


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
