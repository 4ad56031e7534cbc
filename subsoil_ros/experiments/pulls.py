"""Runs of a calibration: each is run once and kept by the hash of its scene; and their evaluation."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analysis.columns import TIME, FacetGroup, PlanarTool
from ..api.execution import execute
from ..api.run_frame import simulate
from ..coupling.engines import Soil
from ..coupling.observer import RunWatch
from ..coupling.run_settings import RunSettings
from ..dem.build import prepare_bed
from ..dem.packing.bed_report import report_bed
from ..errors import RunError
from ..limits.stable_steps import Timing
from ..loading.loader import ResolvedScene, load_scene
from ..messages import ToolMotions, ToolWrenches
from ..scene.bed_kinds import TiledBed
from ..scene.wedge_soil import WedgeValues
from ..ticks import INITIAL_TICK
from .fluctuation import (
    MEAN_LENGTHS_M,
    SAMPLE_M,
    ends_over_deviation,
    octave_power,
    variance_of_means,
    without_trend,
)
from .run_cache import find_run, keep_run, warn_of_other_code
from .wedge_design import Point, WedgeDesign, point_overrides, tip_of, turned_tip_m

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

    def write(self, record: object) -> None:
        if not isinstance(record, ToolMotions | ToolWrenches) or record.tick == INITIAL_TICK:
            return
        if isinstance(record, ToolMotions):
            self.x_m.append(record.tools[0].x_m)
        else:
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
    else:
        warn_of_other_code([kept])
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


START = WedgeValues(
    density_kg_per_m3=1500.0,
    cohesion_pa=1e4,
    friction_angle_rad=0.3,
    adhesion_pa=1e3,
    tool_friction_angle_rad=0.2,
)
"""Values of the wedge model before a fit."""

_WEDGE = (
    "soil={model: wedge, values: " + START.model_dump_json(exclude_none=True) + "}",
    "allow=[]",  # what the scene allows concerns its particles
)

WEDGE_STEP_M = 1e-3
"""Travel in a tick of the wedge model: a tenth of the shortest wave that is compared."""


@dataclass(frozen=True)
class Measured:
    """A point of the design and its runs."""

    point: Point
    scene: ResolvedScene  # on the wedge model
    tip_x_m: float
    numbers: list[PullNumbers]  # one per replicate
    used: bool  # in the fit

    def mean(self, name: str) -> Any:
        """Mean of a number over the replicates."""
        return np.mean([getattr(item, name) for item in self.numbers], axis=0)

    def scatter(self, name: str) -> float:
        """Largest relative departure of a replicate from their mean; 0 with one."""
        values = np.array([getattr(item, name) for item in self.numbers])
        return float(np.max(np.abs(values / values.mean() - 1.0)))


def measure(
    scene: ResolvedScene, design: WedgeDesign, folder: Path, threads: int, progress: RunProgress
) -> list[Measured]:
    """Run the points that are not in the cache, and evaluate all. Raises RunError as kept_pull does."""
    found = []
    name, _ = tip_of(scene)
    shortest = shortest_wave_m(scene)
    for used, points in ((True, design.fit), (False, design.check)):
        for point in points:
            runs, (tip_x_m, _) = [], turned_tip_m(scene, point)
            for replicate in range(point.replicates):
                resolved = load_scene(scene.path, point_overrides(scene, design, point, replicate))
                label = f"{point.name}, run {replicate + 1} of {point.replicates}"
                found_pull = kept_pull(resolved, folder, label, threads, progress)
                runs.append(numbers(found_pull, tip_x_m, design.window_m, shortest))
            step = f"coupling.communication_step_ns={round(1e9 * WEDGE_STEP_M / point.speed_m_per_s)}"
            changes = [
                change
                for change in point_overrides(scene, design, point, 0)
                if not change.startswith("soil.") or change.startswith("soil.bin")  # particles are not there
            ]
            wedge = load_scene(scene.path, (*changes, *_WEDGE, f"tools.{name}.setback_m=0.0", step))
            found.append(Measured(point, wedge, tip_x_m, runs, used))
    groups = scene.scene.tools[name].groups
    if any(len(item.numbers[0].mean_x_newton) != len(groups) for item in found):
        raise RunError(f"{folder}: a cached run has other groups than {', '.join(groups)}; remove the folder")
    return found


def shortest_wave_m(scene: ResolvedScene) -> float:
    """Shortest wavelength that is compared, a radius: shorter waves are of single contacts."""
    soil = scene.scene.particle_soil
    assert soil is not None
    return soil.particles.mean_volume_radius_m


def bed_density_kg_per_m3(scene: ResolvedScene, threads: int = 1) -> float:
    """Mass over the volume between walls, floor and mean top. For a tiled bed, of which a window has only a
    part, it follows from the solid fraction."""
    soil = scene.scene.particle_soil
    assert soil is not None
    if isinstance(soil.bed, TiledBed):
        return soil.bed.solid_fraction * soil.particles.density_kg_per_m3
    return float(report_bed(prepare_bed(scene, threads), soil).density_kg_per_m3)
