"""A finished run of cycle_runs.py, read back over the window that all its tables share."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram

from benchmarks.run_cache import Summary
from subsoil_ros.analysis.columns import DRAFT, TIME, Body, spring_element
from subsoil_ros.analysis.failure_cycles import SMOOTHED_S, FailureCycles, failure_cycles
from subsoil_ros.analysis.metrics_window import tip_path_m
from subsoil_ros.analysis.series import Series, moving_mean, read_series_csv, step_s
from subsoil_ros.loading.loader import load_scene

from .cycle_runs import Case

Values = NDArray[np.float64]

QUANTILES = (0.01, 0.99)
"""Of the 10 ms mean: the extremes of a record grow with its length."""

BEGIN_M, LEAST_M = 0.5, 1e-6
"""Travel of the trolley from which on a run counts, the same in all cases: the tip three depths inside the
field; and travel of the tip from row to row, at least, where values are laid over it."""

SPRING, ANGLE = spring_element("H9_spring").load, Body("shank").angle_rad


class Run:
    """A finished run, from BEGIN_M of travel on, up to `end_m`."""

    def __init__(self, case: Case, summary: Summary, end_m: float = math.inf) -> None:
        self.case, self.summary = case, summary
        self.folder = Path(summary["folder"])
        self.series: Series = read_series_csv(self.folder / "series.csv")
        self.scene = load_scene(self.folder / "scene.yaml")
        trolley = self.series[Body("trolley").x_m]
        travel = trolley - trolley[0]
        self.rows = (travel >= BEGIN_M) & (travel <= end_m)
        path = tip_path_m(self.series, self.scene.scene)
        assert path is not None
        self.tip_m: tuple[Values, Values] = path  # x and z, all rows

    @property
    def draft_mean_newton(self) -> float:
        """Over the window."""
        return float(self.series[DRAFT][self.rows].mean())

    def column(self, name: str, mean_s: float) -> Values:
        """A column over the window, its moving mean."""
        return moving_mean(self.series, name, mean_s)[self.rows]

    def cycles(self, threshold: float) -> FailureCycles | None:
        """Failure cycles of the draft."""
        return self.cycles_of(self.column(DRAFT, SMOOTHED_S), threshold)

    def cycles_of(self, values: Values, threshold: float = 1.0) -> FailureCycles | None:
        """Of any load (n,) over the window."""
        times, tip = self.series[TIME][self.rows], self.tip_m[0][self.rows]
        return failure_cycles(times, tip, values, threshold)

    def over_travel(self, values: Values) -> tuple[float, Values]:
        """Values (n,) over the window at even places of the farthest the tip has been at: their distance [m]
        and themselves."""
        place = np.maximum.accumulate(self.tip_m[0][self.rows])
        new = np.r_[True, np.diff(place) > LEAST_M]
        step = float(place[-1] - place[0]) / len(place)
        return step, np.interp(place[0] + step * np.arange(len(place)), place[new], values[new])

    def periodogram(self, values: Values) -> tuple[Values, Values]:
        """Frequencies [Hz] and one-sided density of values (n,) over the window, trend removed, Hann's
        window."""
        frequency, density = periodogram(values, 1.0 / step_s(self.series), "hann", detrend="linear")
        return frequency, density


def quantile_range(values: Values) -> float:
    """Between the two QUANTILES."""
    return float(np.ptp(np.quantile(values, QUANTILES)))
