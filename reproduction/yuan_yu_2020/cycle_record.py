"""A finished run of cycle_runs.py, read back over the window that all its tables share."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram

from benchmarks.run_cache import Summary
from subsoil_ros.analysis.failure_cycles import SMOOTHED_S, FailureCycles, failure_cycles
from subsoil_ros.analysis.series import Series, read_series_csv
from subsoil_ros.analysis.smoothing import moving_mean, step_s
from subsoil_ros.analysis.window import tip_path_m
from subsoil_ros.loading.loader import load_scene

from .cycle_runs import Case

Values = NDArray[np.float64]

QUANTILES = (0.01, 0.99)
"""Of the 10 ms mean: the extremes of a record grow with its length."""

BEGIN_M, END_M = 0.45, 1.95
"""Travel of the trolley that counts, the same in all cases: from the tip well inside the bin on (chosen). A
window by the tip's place would open in the throw after a failure, always at the same phase of a cycle."""

SPRING, ANGLE = "spring.H9_spring.force_newton", "body.shank.angle_rad"


class Run:
    """A finished run and its window."""

    def __init__(self, case: Case, summary: Summary) -> None:
        self.case, self.summary = case, summary
        self.folder = Path(summary["folder"])
        self.series: Series = read_series_csv(self.folder / "series.csv")
        self.scene = load_scene(self.folder / "scene.yaml")
        trolley = self.series["body.trolley.x_m"]
        travel = trolley - trolley[0]
        self.rows = (travel >= BEGIN_M) & (travel <= END_M)

    @property
    def draft_mean_newton(self) -> float:
        """Over the window."""
        return float(self.series["draft_newton"][self.rows].mean())

    def column(self, name: str, mean_s: float) -> Values:
        """A column over the window, its moving mean."""
        return moving_mean(self.series, name, mean_s)[self.rows]

    def cycles(self, threshold: float) -> FailureCycles | None:
        """Failure cycles of the draft."""
        return self.cycles_of(self.column("draft_newton", SMOOTHED_S), threshold)

    def cycles_of(self, values: Values, threshold: float = 1.0) -> FailureCycles | None:
        """Of any load (n,) over the window."""
        path = tip_path_m(self.series, self.scene.scene)
        assert path is not None
        return failure_cycles(self.series["time_s"][self.rows], path[0][self.rows], values, threshold)

    def periodogram(self, values: Values) -> tuple[Values, Values]:
        """Frequencies [Hz] and one-sided density of values (n,) over the window, trend removed, Hann's
        window."""
        frequency, density = periodogram(values, 1.0 / step_s(self.series), "hann", detrend="linear")
        return frequency, density


def quantile_range(values: Values) -> float:
    """Between the two QUANTILES."""
    return float(np.ptp(np.quantile(values, QUANTILES)))
