"""Workers for the runs of a sweep: on this machine, or of a Dask cluster by its address."""

import logging
import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from ...api.execution import RunResult, code_digest, execute
from ...errors import InputError
from ...loading.scene_bundle import SceneBundle, unpack

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

PATIENCE_S = 20.0
"""Longest wall time to wait for an answer of the scheduler and for its first worker; a wrong address is
reported after this time."""


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
            with _local_cluster(workers) as cluster, Client(cluster) as client:
                client.run(ignore_interrupts)  # in the main thread of each
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
def _local_cluster(workers: int) -> Iterator["LocalCluster"]:
    from distributed import LocalCluster

    with (
        tempfile.TemporaryDirectory(prefix="subsoil-dask-") as folder,
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=None,  # a run cannot be moved to the disk; the system's own limit counts
            local_directory=folder,
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        yield cluster


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
