"""Statistics of a run's metrics window beyond mean, least and largest."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..loading.loader import ResolvedScene
from ..scene.scene import Scene
from ..yaml_document import Document
from .columns import DRAFT, TIME, Body, Wrench, spring_element
from .dead_centre import past_dead_centre_s
from .disturbance import Disturbance, read_disturbance
from .failure_cycles import SMOOTHED_S, FailureCycles, failure_cycles
from .fatigue import LoadCycles, load_cycles
from .loads import loads_of
from .metrics_window import Window, tip_x_m
from .series import Series, moving_mean, step_s
from .spectra import Spectrum, spectrum
from .stationarity import Stationarity, stationarity

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
    shares = [name for name, tool in resolved.scene.tools.items() if tool.is_tillage]
    times, step = series[TIME][rows], step_s(series)
    steady: dict[str, Stationarity] = {}
    spectra: dict[str, Spectrum] = {}
    inside: dict[str, tuple[float, float]] = {}
    whole: dict[str, tuple[float, float]] = {}
    for name in names:
        smooth = moving_mean(series, name, MOVING_S)
        whole[name] = (float(smooth.min()), float(smooth.max()))
        inside[name] = (float(smooth[rows].min()), float(smooth[rows].max()))
        waves = spectrum(step, np.asarray(series[name][rows], np.float64))
        if waves is not None:
            spectra[name] = waves
    for name in (*names, *(Wrench(share).force_z_newton for share in shares)):
        if name not in series:
            continue
        judged = stationarity(times, np.asarray(series[name][rows], np.float64))
        if judged is not None:
            steady[name] = judged
    spring = spring_element(resolved.scene.report.spring).load
    cycles = None
    if spring in series and rows.sum() > 1:
        cycles = load_cycles(series[spring][rows], float(times[-1] - times[0]))
    return RunStatistics(
        loads=loads_of(series, resolved, window),
        stationarity=steady,
        spectra=spectra,
        cycles=cycles,
        failures=failures_of(series, resolved.scene, window),
        disturbance=read_disturbance(bag, resolved, series, window),
        moving_extremes=inside,
        run_extremes=whole,
        past_dead_centre_s=past_dead_centre_s(resolved.scene, series.columns),
    )


def failures_of(series: Series, scene: Scene, window: Window) -> FailureCycles | None:
    """Failure cycles of the draft over a run's window; None without a tip in soil, or with too few."""
    tip = tip_x_m(series, scene)
    if tip is None or scene.soil is None or DRAFT not in series:
        return None
    rows = window.rows
    draft = moving_mean(series, DRAFT, SMOOTHED_S)
    return failure_cycles(series[TIME][rows], tip[rows], draft[rows])


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
