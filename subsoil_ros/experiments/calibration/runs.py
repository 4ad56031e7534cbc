"""Runs of a calibration: each is run once and kept by the hash of its scene; and their evaluation."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...analysis.columns import TIME, FacetGroup, PlanarTool
from ...api.execution import execute
from ...api.run_frame import simulate
from ...coupling.engines import Soil
from ...coupling.observer import RunWatch
from ...coupling.run_settings import RunSettings
from ...errors import RunError
from ...limits.stable_steps import Timing
from ...loading.loader import ResolvedScene
from ...messages import ToolMotions, ToolWrenches
from ...ticks import INITIAL_TICK
from ..run_cache import find_run, keep_run
from .fluctuation import (
    MEAN_LENGTHS_M,
    SAMPLE_M,
    ends_over_deviation,
    octave_power,
    variance_of_means,
    without_trend,
)

RunProgress = Callable[[str, Timing], AbstractContextManager[Callable[[int], None]]]
"""Shows a run, given its name and timing; yields a callback that takes every tick."""


@dataclass(frozen=True)
class Pull:
    """Record of a tool drawn through soil; arrays (n,) per tick, or (n, groups). Forces act on the tool."""

    x_m: NDArray[np.float64]
    force_x_newton: NDArray[np.float64]
    force_z_newton: NDArray[np.float64]
    groups: tuple[str, ...]


@dataclass(frozen=True)
class PullNumbers:
    """Means and fluctuation of a pull over its window."""

    mean_x_newton: NDArray[np.float64]  # (groups,)
    mean_z_newton: NDArray[np.float64]
    draft_newton: float
    deviation_newton: float  # standard deviation of the draft about its trend
    ends_over_deviation: NDArray[np.float64]  # (2,) of the draft about its trend
    octave_power: NDArray[np.float64]  # [N2] of the draft about its trend, of waves between octave_edges_m
    variance_of_means: NDArray[np.float64]  # [N2] of the draft about its trend, over each of MEAN_LENGTHS_M


class _Sink:
    """Sink of the records of a run with one tool."""

    def __init__(self) -> None:
        self.x_m: list[float] = []
        self.forces: list[list[tuple[float, float]]] = []
        self.groups: tuple[str, ...] = ()

    def write(self, record: Any) -> None:
        if record.tick == INITIAL_TICK:
            return
        if isinstance(record, ToolMotions):
            self.x_m.append(record.tools[0].x_m)
        elif isinstance(record, ToolWrenches):
            found = record.tools[0].groups
            self.groups = tuple(group.group for group in found)
            self.forces.append([(group.force_x_newton, group.force_z_newton) for group in found])


def pull(
    scene: ResolvedScene,
    soil: Soil | None = None,
    on_tick: Callable[[int], None] = lambda tick: None,
    threads: int = 1,
) -> Pull:
    """Run a scene with one tool on a path; soil: replaces that of the scene."""
    sink = _Sink()
    simulate(RunSettings(scene, threads=threads), soil=soil, sink=sink, observer=RunWatch(on_tick))
    forces = np.array(sink.forces)
    return Pull(np.array(sink.x_m), forces[:, :, 0], forces[:, :, 1], sink.groups)


def kept_pull(scene: ResolvedScene, folder: Path, name: str, threads: int, progress: RunProgress) -> Pull:
    """The pull of a scene whose series has every tick, from `folder` where it has been run before.

    A run is kept once it is complete, so a stopped calibration continues with the next run; a failed run is
    repeated.

    Raises:
        RunError, InputError: the run failed; its message names the point.
    """
    kept = find_run(folder, scene.scene_hash)
    if kept is None or kept.failure is not None:
        with progress(name, scene.timing) as on_tick:
            kept = keep_run(folder, scene, execute(scene, threads, on_tick))
    if kept.failure is not None:
        raise kept.error(name)
    tool, keys = next(iter(scene.scene.tools.items()))
    series, groups = kept.series(), [FacetGroup(tool, group) for group in keys.groups]
    run = series[TIME] > 0.0
    return Pull(
        series[PlanarTool(tool).x_m][run],
        np.column_stack([series[group.force_x_newton][run] for group in groups]),
        np.column_stack([series[group.force_z_newton][run] for group in groups]),
        tuple(keys.groups),
    )


def numbers(
    found: Pull, tip_x_m: float, window_m: tuple[float, float], shortest_wave_m: float
) -> PullNumbers:
    """Means and fluctuation over a window of the tip; tip_x_m: of the tip from the tool's origin."""
    tip = found.x_m + tip_x_m
    rows = (tip >= window_m[0]) & (tip <= window_m[1])
    if rows.sum() < 10:
        raise RunError(f"window_m {window_m}: the tip was there in {int(rows.sum())} ticks; draw it further")
    draft = -found.force_x_newton[rows].sum(axis=1)
    about = without_trend(np.interp(np.arange(*window_m, SAMPLE_M), tip[rows], draft))
    return PullNumbers(
        mean_x_newton=found.force_x_newton[rows].mean(axis=0),
        mean_z_newton=found.force_z_newton[rows].mean(axis=0),
        draft_newton=float(draft.mean()),
        deviation_newton=float(about.std()),
        ends_over_deviation=ends_over_deviation(about),
        octave_power=octave_power(about, shortest_wave_m),
        variance_of_means=np.array([variance_of_means(about, length) for length in MEAN_LENGTHS_M]),
    )
