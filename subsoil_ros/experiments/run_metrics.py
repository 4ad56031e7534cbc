"""The numbers that accuracy is judged by, read off a cached run."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram

from ..analysis.columns import DRAFT, TIME, Wrench, spring_element
from ..analysis.failure_cycles import SMOOTHED_S
from ..analysis.series import Columns, moving_mean
from ..analysis.spectra import LEAST_ROWS, spectrum
from ..analysis.summarize import MOVING_S
from ..analysis.summary import Number, StationarityMetrics, Summary
from .run_cache import CachedRun

SWING_S = 0.3
"""Length of the segments that a swing is the median of (chosen: two periods of the paper's shank)."""

SWING_ROWS = 10
"""Rows that a segment must have (chosen: four to five in a period of the paper's shank, 7.6 Hz)."""


@dataclass(frozen=True)
class Metric:
    """One number of a run."""

    name: str  # with its unit
    label: str
    relative: bool = True  # its error is a part of the reference's value, else a difference
    resolution: str | None = None  # key of what a run can tell of it
    absent_in_some: str = ""  # why not every run has it
    unit: str = ""
    part_of: str = ""  # its error is a part of the reference's value of this one; its own may be near zero


METRICS = (
    Metric("draft_mean_newton", "mean draft"),
    Metric("draft_peak_newton", "peak draft"),
    Metric("draft_deviation_newton", "draft deviation"),
    Metric("vertical_mean_newton", "vertical force over draft", part_of="draft_mean_newton"),
    Metric("spring_deviation_newton", "spring force deviation"),
    Metric("spring_range_newton", "spring force range"),
    Metric("spring_detrended_std_newton", "spring force swing"),
    Metric(
        "draft_frequency_hz",
        "dominant frequency",
        resolution="frequency_resolution_hz",
        absent_in_some="there is one where a peak of the draft's spectrum stands out of red noise",
        unit="Hz",
    ),
    Metric("disturbed_area_m2", "disturbed area"),
    Metric("energy_residual", "energy residual", relative=False),
)


def metrics_of(run: CachedRun) -> dict[str, float]:
    """Every metric that a run has a column for, over its metrics window; by Metric.name, resolutions too.

    Peak and range are of the 10 ms moving mean; the range does not tell vibration from a bed that gives way
    once, so there is the swing. There is a dominant frequency only where a peak of the draft's spectrum
    stands out of red noise.
    """
    summary, series = run.metrics, run.series()
    times = series[TIME]
    rows = (times >= _known(summary.window.start_s)) & (times <= _known(summary.window.end_s))
    found = {"energy_residual": abs(_known(summary.energy.residual_ratio))}
    if DRAFT in series:
        draft = series[DRAFT]
        found["draft_mean_newton"] = float(np.mean(draft[rows]))
        found["draft_peak_newton"] = float(np.max(moving_mean(series, DRAFT, MOVING_S)[rows]))
        found["draft_deviation_newton"] = deviation(series, DRAFT, rows)
        found["draft_frequency_hz"] = dominant_frequency_hz(times[rows], draft[rows])
        length_s = float(np.ptp(times[rows]))
        found["frequency_resolution_hz"] = 1.0 / length_s if length_s > 0.0 else math.nan
    spring = spring_of(run)
    if spring is not None and (name := spring_element(spring).load) in series:
        found["spring_range_newton"] = float(np.ptp(moving_mean(series, name, MOVING_S)[rows]))
        found["spring_deviation_newton"] = deviation(series, name, rows)
        found["spring_detrended_std_newton"] = swing(times[rows], series[name][rows])
    upward = [series[name][rows] for name in _upward_columns(run) if name in series]
    if upward:
        found["vertical_mean_newton"] = float(np.mean(np.sum(upward, axis=0)))
    if summary.disturbance is not None:
        found["disturbed_area_m2"] = _known(summary.disturbance.area_m2)
    return {name: value for name, value in found.items() if math.isfinite(value)}


def half_widths_of(run: CachedRun, metrics: Mapping[str, float]) -> dict[str, float]:
    """Half-widths of the 95 % intervals that a run's own record gives, of its metrics that have one.

    Of means and deviations those of analysis/stationarity.py; a deviation's is scaled to the 20 ms mean. The
    vertical force has one where a single tool works the soil.
    """
    summary = run.metrics
    found: dict[str, Number] = {}
    draft = _stationarity(summary, DRAFT)
    if draft is not None:
        found["draft_mean_newton"] = draft.mean_half_width
    for key, record in (
        ("draft_deviation_newton", draft),
        ("spring_deviation_newton", _stationarity(summary, spring_element(spring_of(run)).load)),
    ):
        if record is not None and record.deviation and key in metrics:
            found[key] = _known(record.deviation_half_width) * metrics[key] / record.deviation
    upward = _upward_columns(run)
    vertical = _stationarity(summary, upward[0]) if len(upward) == 1 else None
    if vertical is not None:
        found["vertical_mean_newton"] = vertical.mean_half_width
    if summary.disturbance is not None:
        found["disturbed_area_m2"] = summary.disturbance.area_half_width_m2
    return {name: float(value) for name, value in found.items() if value is not None and math.isfinite(value)}


def _stationarity(summary: Summary, name: str) -> StationarityMetrics | None:
    column = summary.series.get(name)
    return None if column is None else column.stationarity


def _known(number: Number) -> float:
    return math.nan if number is None else float(number)


def deviation(series: Columns, name: str, rows: NDArray[np.bool_]) -> float:
    """Standard deviation of a column's 20 ms mean about a straight line over rows (n,); nan with fewer than
    three of them, as a line meets two."""
    if np.count_nonzero(rows) < 3:
        return math.nan
    times, values = series[TIME][rows], moving_mean(series, name, SMOOTHED_S)[rows]
    return float(np.std(values - np.polyval(np.polyfit(times - times[0], values, 1), times - times[0])))


def _upward_columns(run: CachedRun) -> list[str]:
    """Columns of the upward force of the soil on each tillage tool."""
    tools: dict[str, dict[str, object]] = run.scene.get("tools") or {}
    return [Wrench(key).force_z_newton for key, tool in tools.items() if tool.get("role") != "wheel"]


def spring_of(run: CachedRun) -> str | None:
    """The spring that the run's scene reports."""
    spring = (run.scene.get("report") or {}).get("spring")
    return None if spring is None else str(spring)


def swing(times_s: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Standard deviation about a straight line, the median over segments of 0.3 s that overlap by half.

    A fall, however steep, is in two or three of the segments, so the median is of the vibration beside it;
    nan with fewer than three segments, or fewer than ten rows in one.
    """
    starts = np.arange(times_s[0], times_s[-1] - SWING_S + 1e-9, 0.5 * SWING_S)
    first, last = np.searchsorted(times_s, starts - 1e-9), np.searchsorted(times_s, starts + SWING_S - 1e-9)
    found = []
    for start, low, high in zip(starts, first, last, strict=True):
        if high - low < SWING_ROWS:
            return math.nan
        since, segment = times_s[low:high] - start, values[low:high]
        found.append(np.std(segment - np.polyval(np.polyfit(since, segment, 1), since)))
    return float(np.median(found)) if len(found) >= 3 else math.nan


def dominant_frequency_hz(times_s: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Frequency of the peak about the trend that stands out of red noise (spectra.py); nan where none does.

    Welch's estimate finds it; the periodogram of the whole window, four times as fine, places it. A window of
    length T resolves 1 / T, so differences below that are none.
    """
    count = len(times_s)
    if count < LEAST_ROWS:
        return math.nan
    step_s = float(times_s[-1] - times_s[0]) / (count - 1)
    even = np.interp(times_s[0] + step_s * np.arange(count), times_s, values)  # the last tick may stand off
    found = spectrum(step_s, even)
    if found is None or not found.significant:
        return math.nan
    frequency, density = periodogram(even, 1.0 / step_s, window="hann", detrend="linear")
    near = np.flatnonzero(np.abs(frequency - found.dominant_hz) <= found.resolution_hz)
    return float(frequency[near[np.argmax(density[near])]])
