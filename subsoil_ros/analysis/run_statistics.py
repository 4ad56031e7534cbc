"""Everything that is found out about a run's window beyond mean, least and largest."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..loading.loader import ResolvedScene
from ..scene.model import Scene
from .dead_centre import past_dead_centre_s
from .disturbance import Disturbance, read_disturbance
from .failure_cycles import SMOOTHED_S, FailureCycles, failure_cycles
from .fatigue import LoadCycles, load_cycles
from .loads import Loads, loads_of
from .series import Series
from .smoothing import moving_mean, step_s
from .spectra import Spectrum, spectrum
from .stationarity import Stationarity, stationarity
from .window import Window, tip_x_m

MOVING_S = 0.010
"""Time of the moving mean whose extremes are compared: over the noise of single contacts (as measured with
the prototypes, whose 10 ms peaks the first results give)."""


@dataclass(frozen=True)
class RunStatistics:
    """Of the metrics window of one run; quantities by the names of their columns."""

    loads: Loads
    stationarity: dict[str, Stationarity]
    spectra: dict[str, Spectrum]
    cycles: LoadCycles | None
    failures: FailureCycles | None
    disturbance: Disturbance | None
    moving_extremes: dict[str, tuple[float, float]]  # of the 10 ms moving mean
    run_extremes: dict[str, tuple[float, float]]
    past_dead_centre_s: float | None  # when the shank passed that of its spring

    def metrics(self) -> dict[str, Any]:
        """Flat, as summary.json holds them; what is not finite is left out."""
        found: dict[str, Any] = {}
        for prefix, extremes in (("", self.moving_extremes), ("run.", self.run_extremes)):
            for name, (low, high) in extremes.items():
                found[f"{prefix}{name}_10ms_min"], found[f"{prefix}{name}_10ms_max"] = low, high
                found[f"{prefix}{name}_10ms_range"] = high - low
        found.update(self.loads.metrics)
        if self.past_dead_centre_s is not None:
            found["shank.past_dead_centre_s"] = self.past_dead_centre_s
        for name, steady in self.stationarity.items():
            found.update(_of_stationarity(f"steady.{name}", steady))
        for name, item in self.spectra.items():
            found[f"spectrum.{name}_dominant_hz"] = item.dominant_hz
            found[f"spectrum.{name}_resolution_hz"] = item.resolution_hz
            found[f"spectrum.{name}_degrees_of_freedom"] = item.degrees_of_freedom
            found[f"spectrum.{name}_significant"] = item.significant
        if self.cycles is not None:
            found["rainflow.cycle_count"] = float(self.cycles.count.sum())
            found["rainflow.max_range_newton"] = self.cycles.max_range_newton
            found["rainflow.equivalent_range_newton"] = self.cycles.equivalent_range_newton()
        if self.failures is not None:
            found.update(self.failures.metrics())
        if self.disturbance is not None:
            found.update(self.disturbance.metrics())
            found.update(_per_area(found, self.disturbance.area_m2))
        return {
            key: value for key, value in found.items() if not isinstance(value, float) or math.isfinite(value)
        }


def compared_columns(scene: Scene) -> tuple[str, ...]:
    """Columns that every designer asks for: draft, spring, angle and height."""
    report = scene.report
    names = ["draft_newton"]
    if report.spring is not None:
        names.append(f"spring.{report.spring}.force_newton")
    if report.shank is not None:
        names += [f"body.{report.shank}.angle_rad", f"body.{report.shank}.z_m"]
    return tuple(names)


def run_statistics(bag: Path, resolved: ResolvedScene, series: Series, window: Window) -> RunStatistics:
    """Of a run's bag, series and window.

    Raises:
        InputError, RecordingError: as open_record.
    """
    rows = window.rows
    names = [name for name in compared_columns(resolved.scene) if name in series]
    times, step = series["time_s"][rows], step_s(series)
    steady: dict[str, Stationarity] = {}
    spectra: dict[str, Spectrum] = {}
    inside: dict[str, tuple[float, float]] = {}
    whole: dict[str, tuple[float, float]] = {}
    for name in names:
        smooth = moving_mean(series, name, MOVING_S)
        whole[name] = (float(smooth.min()), float(smooth.max()))
        inside[name] = (float(smooth[rows].min()), float(smooth[rows].max()))
        values = np.asarray(series[name][rows], np.float64)
        judged = stationarity(times, values)
        if judged is not None:
            steady[name] = judged
        waves = spectrum(step, values)
        if waves is not None:
            spectra[name] = waves
    spring = f"spring.{resolved.scene.report.spring}.force_newton"
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
    if tip is None or scene.soil is None or "draft_newton" not in series:
        return None
    rows = window.rows
    draft = moving_mean(series, "draft_newton", SMOOTHED_S)
    return failure_cycles(series["time_s"][rows], tip[rows], draft[rows])


def _of_stationarity(prefix: str, steady: Stationarity) -> dict[str, Any]:
    return {
        f"{prefix}_mean_half_width": steady.mean_half_width,
        f"{prefix}_correlation_s": steady.correlation_s,
        f"{prefix}_effective_count": steady.effective_count,
        f"{prefix}_slope_per_s": steady.slope_per_s,
        f"{prefix}_slope_half_width_per_s": steady.slope_half_width_per_s,
        f"{prefix}_drift": steady.drift,
        f"{prefix}_drift_half_width": steady.drift_half_width,
        f"{prefix}_verdict": steady.verdict,
        f"{prefix}_block_means": list(steady.block_means),
    }


def _per_area(found: dict[str, Any], area_m2: float) -> dict[str, float]:
    """Draft and energy over what was loosened."""
    if area_m2 <= 0.0:
        return {}
    per: dict[str, float] = {}
    if "specific.energy_joule_per_m" in found:
        per["specific.energy_joule_per_m3"] = found["specific.energy_joule_per_m"] / area_m2
    if "specific.draft_newton_per_m" in found:
        draft = found["specific.draft_newton_per_m"] * found["specific.share_width_m"]
        per["specific.draft_pa"] = draft / area_m2
    return per
