"""Statistics and metrics of a finished run, from its bag; the software and the machine that made it."""

import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path

import numpy as np

from .._version import __version__
from ..loading.loader import ResolvedScene
from ..messages import Command, Grant, LostParticle, SoilState
from ..recording.bag_reader import BagReader
from ..recording.joined import open_record
from ..scene.scene import Scene
from ..ticks import tick_end_s
from ..yaml_document import Document
from .columns import COUPLING, DRAFT, SOIL, TIME, Body, Wrench, spring_element
from .dead_centre import past_dead_centre_s
from .disturbance import Disturbance, read_disturbance, write_height_map_csv, write_section_csv
from .failure_cycles import SMOOTHED_S, FailureCycles, failure_cycles
from .fatigue import LoadCycles, load_cycles, write_cycles_csv
from .fitted_range import extrapolated
from .loads import loads_of
from .metrics_window import Window, metrics_window, tip_x_m, window_span_s
from .series import Series, moving_mean, read_series, step_s
from .spectra import Spectrum, spectrum, write_spectra_csv
from .stationarity import Stationarity, stationarity
from .summary import SCHEMA_VERSION, Summary, UnrecordedSummary

PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "pydantic", "trimesh", "mcap", "rosbags", "ros-rclpy")
"""Packages whose versions may change results, or how they are recorded."""

MOVING = "moving_10ms"
"""Key of the extremes of the moving mean over MOVING_S."""

MOVING_S = 0.010
"""Time of the moving mean whose extremes are compared: longer than the noise of single contacts (measured on
the prototypes, whose first results also state 10 ms peaks)."""


@dataclass(frozen=True)
class RunStatistics:
    """Statistics of the metrics window of one run; quantities by the names of their columns."""

    loads: Document
    stationarity: dict[str, Stationarity]
    spectra: dict[str, Spectrum]
    cycles: LoadCycles | None
    failures: FailureCycles | None
    disturbance: Disturbance | None
    moving_extremes: dict[str, tuple[float, float]]  # of the 10 ms moving mean
    run_extremes: dict[str, tuple[float, float]]
    past_dead_centre_s: float | None  # when the shank passed that of its spring
    extrapolated: Document  # what left the fitted range of a wedge model

    def column_metrics(self) -> dict[str, Document]:
        """Groups of single columns, by column, beside their mean: values of the fields of summary.Column."""
        found: dict[str, Document] = {}
        for name, extremes in self.moving_extremes.items():
            found[name] = {MOVING: _span(extremes), "run": {MOVING: _span(self.run_extremes[name])}}
        for name, steady in self.stationarity.items():
            found.setdefault(name, {})["stationarity"] = steady
        for name, item in self.spectra.items():
            found.setdefault(name, {})["spectrum"] = item
        return found

    def metrics(self) -> Document:
        """Groups of the whole run: values of fields of summary.Summary; what it does not have is absent."""
        loads = dict(self.loads)
        if self.past_dead_centre_s is not None:
            loads["past_dead_centre_s"] = self.past_dead_centre_s
        if self.extrapolated:
            loads["extrapolated"] = self.extrapolated
        if self.cycles is not None:
            loads["rainflow"] = {
                "cycle_count": float(self.cycles.count.sum()),
                "max_range_newton": self.cycles.max_range_newton,
                "equivalent_range_newton": self.cycles.equivalent_range_newton(),
            }
        found: Document = {"loads": loads}
        if self.failures is not None:
            found["failure_cycles"] = self.failures.metrics()
        if self.disturbance is not None:
            found["disturbance"] = self.disturbance.metrics()
            loads["specific"] |= _per_area(loads["specific"], self.disturbance.area_m2)
        return found

    def write_tables(self, directory: Path) -> None:
        """Write spectra.csv, load_cycles.csv, height_map.csv and loosened_section.csv of what the run has."""
        if self.spectra:
            write_spectra_csv(self.spectra, directory / "spectra.csv")
        if self.cycles is not None:
            write_cycles_csv(self.cycles, directory / "load_cycles.csv")
        if self.disturbance is not None:
            write_height_map_csv(self.disturbance.lift, directory / "height_map.csv")
            write_section_csv(self.disturbance, directory / "loosened_section.csv")


def compared_columns(scene: Scene) -> tuple[str, ...]:
    """Columns that are compared between runs: draft, spring force, angle and height."""
    report = scene.report
    names = [DRAFT]
    if report.spring is not None:
        names.append(spring_element(report.spring).load)
    if report.shank is not None:
        names += [Body(report.shank).angle_rad, Body(report.shank).z_m]
    return tuple(names)


def run_statistics(bag: Path, resolved: ResolvedScene, series: Series, window: Window) -> RunStatistics:
    """Compute the statistics from a run's bag, series and window.

    Raises:
        InputError, RecordingError: as open_record.
    """
    rows = window.rows
    names = [name for name in compared_columns(resolved.scene) if name in series]
    tillage = [Wrench(name) for name, tool in resolved.scene.tools.items() if tool.is_tillage]
    loads = [(load.force_z_newton, load.force_y_newton, load.torque_y_newton_m) for load in tillage]
    judged = [*names, *(name for name in chain(*loads) if name in series)]
    inside = {name: np.asarray(series[name][rows], np.float64) for name in judged}
    times, smooth = series[TIME][rows], {name: moving_mean(series, name, MOVING_S) for name in names}
    steady = {name: stationarity(times, inside[name]) for name in judged}
    spectra = {name: spectrum(step_s(series), inside[name]) for name in names}
    spring = spring_element(resolved.scene.report.spring).load
    cycles = None
    if spring in series and rows.sum() > 1:
        cycles = load_cycles(series[spring][rows], float(times[-1] - times[0]))
    return RunStatistics(
        loads=loads_of(series, resolved, window),
        stationarity={name: found for name, found in steady.items() if found is not None},
        spectra={name: found for name, found in spectra.items() if found is not None},
        cycles=cycles,
        failures=failures_of(series, resolved.scene, window),
        disturbance=read_disturbance(bag, resolved, series, window),
        moving_extremes={name: _extremes(values[rows]) for name, values in smooth.items()},
        run_extremes={name: _extremes(values) for name, values in smooth.items()},
        past_dead_centre_s=past_dead_centre_s(resolved.scene, series.columns),
        extrapolated=extrapolated(series, resolved, window),
    )


def failures_of(series: Series, scene: Scene, window: Window) -> FailureCycles | None:
    """Failure cycles of the draft over a run's window; None without a tip in soil, or with too few."""
    tip = tip_x_m(series, scene)
    if tip is None or scene.soil is None or DRAFT not in series:
        return None
    rows = window.rows
    draft = moving_mean(series, DRAFT, SMOOTHED_S)
    return failure_cycles(series[TIME][rows], tip[rows], draft[rows])


def _extremes(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _span(extremes: tuple[float, float]) -> dict[str, float]:
    low, high = extremes
    return {"min": low, "max": high, "range": high - low}


def _per_area(found: Document, area_m2: float) -> dict[str, float]:
    """Draft and energy divided by the loosened section."""
    if area_m2 <= 0.0:
        return {}
    per: dict[str, float] = {}
    if "energy_joule_per_m" in found:
        per["energy_joule_per_m3"] = found["energy_joule_per_m"] / area_m2
    if "draft_newton_per_m" in found:
        draft = found["draft_newton_per_m"] * found["share_width_m"]
        per["draft_pa"] = draft / area_m2
    return per


def summarize(
    bag: Path,
    resolved: ResolvedScene,
    run_info: Document,
    series: Series | None = None,
    statistics: RunStatistics | None = None,
) -> Summary:
    """Metrics of a finished run.

    run_info: facts that are not in the bag: fields of summary.RunFacts.
    series, statistics: of the bag, if they are known already.

    Raises:
        InputError, RecordingError: as read_series.
    """
    scene, timing = resolved.scene, resolved.timing
    series = series if series is not None else read_series(bag, scene)
    window = metrics_window(series, resolved)
    statistics = statistics if statistics is not None else run_statistics(bag, resolved, series, window)
    start_s, end_s = window_span_s(series, window)
    simulated_s = float(series[TIME][-1])
    tick_count = round(simulated_s / timing.communication_step_s)
    wall_s = series.wall_time_s  # of the ticks alone: without start-up and compilation
    columns = statistics.column_metrics()
    return Summary.model_validate(
        {
            **_heading(resolved),
            "run": {
                "id": series.run_id,
                **run_info,
                "recorded": True,
                "complete": tick_count == timing.tick_count or _ended_early(bag, scene),
                "simulated_s": simulated_s,
                "ticks": tick_count,
                "steps": tick_count * (timing.soil_steps or timing.mechanism_steps),
                "wall_s": wall_s,
                "real_time_factor": simulated_s / wall_s if wall_s > 0.0 else 0.0,
            },
            "particles": _particles(series, bag, timing.communication_step_ns),
            "energy": {
                "residual_joule": float(series[COUPLING.residual_joule][-1]),
                "residual_ratio": float(series[COUPLING.residual_ratio][-1]),
            },
            "window": {
                "rule": window.rule,
                "whole_run": window.whole_run,
                "start_s": start_s,
                "end_s": end_s,
                "rows": int(window.rows.sum()),
            },
            "series": {
                name: _of_column(values, window.rows, columns.get(name, {}))
                for name, values in series.columns.items()
                if name != TIME
            },
            **statistics.metrics(),
        },
        from_attributes=True,
    )


def _ended_early(bag: Path, scene: Scene) -> bool:
    """Whether a run with stop_when has its END, which the last grant of the record carries."""
    if scene.stop_when is None:
        return False
    end_ns = BagReader(bag).end_time_ns
    grants = BagReader(bag).records(Grant, at=lambda time_ns: time_ns == end_ns)
    return any(grant.command is Command.END for grant in grants)


def summarize_unrecorded(resolved: ResolvedScene, run_info: Document) -> UnrecordedSummary:
    """Summary of a run without a bag: what is known without its record."""
    run = {**run_info, "recorded": False, "complete": "failure" not in run_info}
    return UnrecordedSummary.model_validate({**_heading(resolved), "run": run})


def _heading(resolved: ResolvedScene) -> Document:
    scene = resolved.scene
    return {
        "schema_version": SCHEMA_VERSION,
        "scene": {
            "name": scene.name,
            "hash": resolved.scene_hash,
            "allow": list(scene.allow),
            "note": scene.report.note,
        },
    }


def _particles(series: Series, bag: Path, communication_step_ns: int) -> Document:
    """Numbers of particles present and lost; the first row with a lost one, and their identities."""
    if SOIL.lost_particle_count not in series:
        return {"count": 0, "lost_count": 0, "first_lost_s": None, "first_lost": []}
    lost = series[SOIL.lost_particle_count]
    first = float(series[TIME][np.argmax(lost > 0)]) if lost[-1] > 0 else None
    named: tuple[LostParticle, ...] = ()
    if first is not None:
        last_ns = round(1e9 * float(series[TIME][-1]))
        for state in open_record(bag).records(SoilState, at=lambda time_ns: time_ns == last_ns):
            named = state.lost_particles
    return {
        "count": int(series[SOIL.particle_count][-1]),
        "lost_count": int(lost[-1]),
        "first_lost_s": first,
        "first_lost": [
            {
                "identity": item.identity,
                "position_m": [item.x_m, item.y_m, item.z_m],
                "time_s": tick_end_s(item.tick, communication_step_ns),
            }
            for item in named
        ],
    }


def _of_column(values: np.ndarray, rows: np.ndarray, more: Document) -> Document:
    """Statistics of a column (n,) over the window, `rows`, and under `run` over all of it."""
    run = {**_statistics(values), **more.get("run", {})}
    return {**_statistics(values[rows]), **more, "run": run}


def _statistics(values: np.ndarray) -> Document:
    return {
        "mean": float(np.mean(values)),
        "min": values.min().item(),
        "max": values.max().item(),
        "std": float(np.std(values)),
    }


def versions() -> dict[str, str]:
    """Versions by name, with system and processor; packages that are not installed are left out."""
    found = {"subsoil_ros": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found | {"system": platform.platform(), "processor": processor_name()}


def processor_name() -> str:
    """Model of this machine's processor; its architecture where the system does not give the model."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
