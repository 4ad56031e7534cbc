"""One run of a scene in this process, without ROS, down to its series and its metrics."""

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from .._version import __version__
from ..analysis.summarize import processor_name
from ..coupling.observer import RunWatch
from ..coupling.run_settings import RunSettings
from ..errors import InputError
from ..loading.loader import ResolvedScene
from ..source_digest import result_digest
from ..yaml_document import Document
from .run_frame import RunFrame, simulate

WARM_UP_TICKS = 3
"""Ticks that load or compile the kernels before a run is timed."""


@dataclass(frozen=True)
class RunResult:
    """A run that has ended: series.csv and summary.json as bytes, and its times.

    facts: failure (None: there was none) and its exit_status; wall_s and cpu_s of the ticks but the first,
    scaled to all of them; whole_wall_s with start-up; threads, at_once, machine, version, code.
    """

    files: dict[str, bytes]
    facts: Document


class _Stopwatch(RunWatch):
    """Wall and CPU time [s] of a run's ticks; the first one, which loads kernels, does not count."""

    def __init__(self, show: Callable[[int], None]) -> None:
        super().__init__(show)
        self._first = self._last = (0.0, 0.0)
        self._count = 0

    def on_tick(self, tick: int) -> None:
        self._last = time.perf_counter(), time.process_time()
        if self._count == 0:
            self._first = self._last
        self._count += 1
        super().on_tick(tick)

    def times(self) -> tuple[float | None, float | None]:
        """(wall, CPU) of all ticks, from the mean of those after the first; None with fewer than two."""
        if self._count < 2:
            return None, None
        scale = self._count / (self._count - 1)
        wall_s, cpu_s = (scale * (last - first) for first, last in zip(self._first, self._last, strict=True))
        return wall_s, cpu_s


def execute(
    resolved: ResolvedScene,
    threads: int = 1,
    on_tick: Callable[[int], None] = lambda tick: None,
    *,
    at_once: int = 1,
    warm_up: bool = False,
) -> RunResult:
    """Run a scene in direct mode. A failed run returns its message and the series up to the failure.

    at_once: number of runs that share this machine, recorded only.
    warm_up: first run a few ticks of it, so that no kernel is loaded or compiled while the time is taken.
    """
    stopwatch = _Stopwatch(on_tick)
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="subsoil-run-") as name:
        folder = Path(name) / "run"
        folder.mkdir()
        frame = RunFrame(RunSettings(resolved, "kept", bag=folder / "bag", threads=threads), folder, None)

        def work() -> None:
            if warm_up:
                ticks = min(WARM_UP_TICKS, resolved.timing.tick_count)
                short = replace(resolved, timing=replace(resolved.timing, tick_count=ticks))
                simulate(RunSettings(short, threads=threads))
            frame.simulate(stopwatch)

        try:
            _, failure = frame.complete("direct", work, stopwatch, lasting=False)
        except InputError as error:
            failure = error
        wall_s, cpu_s = stopwatch.times()
        facts = {
            "failure": None if failure is None else str(failure),
            "exit_status": 0 if failure is None else failure.exit_status,
            "wall_s": wall_s,
            "cpu_s": cpu_s,
            "whole_wall_s": time.perf_counter() - start,
            "threads": threads,
            "at_once": at_once,
            "machine": machine_name(),
            "version": __version__,
            "code": code_digest(),
        }
        paths = {name: folder / name for name in ("series.csv", "summary.json")}
        return RunResult({name: path.read_bytes() for name, path in paths.items() if path.is_file()}, facts)


def code_digest() -> str:
    """16 hex digits of all code that results depend on: runs with other digits are not fully comparable."""
    return result_digest()[:16]


def machine_name() -> str:
    """The processor and how many of its cores this process may use."""
    return f"{processor_name()}, {len(os.sched_getaffinity(0))} cores"
