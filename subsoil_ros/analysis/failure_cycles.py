"""Failure cycles: travel of a tool from one failure of the soil to the next, and how the load rises and
falls.

A failure is a peak of the draft with a prominence of a standard deviation or more. Prominence is the height
of a peak above the higher one of the two minima that separate it from higher peaks. The trough between two
failures separates unloading from loading. The count depends on the threshold, so the threshold is part of
the result.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..yaml_document import Document
from .intervals import Interval, mean_interval

SMOOTHED_S = 0.020
"""Length of the moving mean in which peaks are searched: a seventh of the period of the paper's shank on its
spring, and longer than a single contact lasts."""

THRESHOLD = 1.0
"""Prominence of a failure in standard deviations of the draft: ripples while the soil is loaded reach a half.
reproduction/yuan_yu_2020/cycle.md also has the results at 0.5 and 1.5."""

LEAST_CYCLES = 2
"""Smallest number of cycles: one cycle has no standard deviation."""


@dataclass(frozen=True)
class FailureCycles:
    """Cycles from failure to failure; arrays (n,)."""

    threshold_newton: float  # prominence of a failure
    failures: NDArray[np.int64]  # (n + 1,) rows of the series given
    travel_m: NDArray[np.float64]
    time_s: NDArray[np.float64]
    loading_fraction: float  # part of the time in which the draft rises from a trough to a failure
    unloading_over_loading: float  # mean rate of the fall over that of the rise

    @property
    def count(self) -> int:
        """Number of cycles."""
        return len(self.travel_m)

    @property
    def travel(self) -> Interval:
        """Mean travel between failures with its 95 % interval [m]."""
        return mean_interval(self.travel_m.tolist())

    def metrics(self) -> Document:
        """Return the metrics for summary.json, units in the names."""
        return {
            "count": self.count,
            "threshold_newton": self.threshold_newton,
            "travel_m": {
                "mean": self.travel.mean,
                "half_width": self.travel.half_width,
                "deviation": float(self.travel_m.std(ddof=1)),
            },
            "time_s": {"mean": float(self.time_s.mean()), "deviation": float(self.time_s.std(ddof=1))},
            "loading_fraction": self.loading_fraction,
            "unloading_over_loading": self.unloading_over_loading,
        }


def failure_cycles(
    times_s: NDArray[np.float64],
    travel_m: NDArray[np.float64],
    draft_newton: NDArray[np.float64],
    threshold: float = THRESHOLD,
) -> FailureCycles | None:
    """Cycles of a draft (n,) at `times_s` (n,) over the travel of the tip (n,); None for fewer than
    LEAST_CYCLES.

    Args:
        draft_newton: its moving mean over SMOOTHED_S.
        threshold: prominence of a failure in standard deviations.
    """
    from scipy.signal import find_peaks

    prominence = threshold * float(draft_newton.std())
    if prominence == 0.0:
        return None
    peaks = find_peaks(draft_newton, prominence=prominence)[0]
    if len(peaks) <= LEAST_CYCLES:
        return None
    troughs = np.array(
        [first + int(np.argmin(draft_newton[first:last])) for first, last in itertools.pairwise(peaks)]
    )
    loading_s = float((times_s[peaks[1:]] - times_s[troughs]).sum())
    unloading_s = float((times_s[troughs] - times_s[peaks[:-1]]).sum())
    rise = float((draft_newton[peaks[1:]] - draft_newton[troughs]).sum())
    fall = float((draft_newton[peaks[:-1]] - draft_newton[troughs]).sum())
    return FailureCycles(
        threshold_newton=prominence,
        failures=peaks,
        travel_m=np.diff(travel_m[peaks]),
        time_s=np.diff(times_s[peaks]),
        loading_fraction=loading_s / (loading_s + unloading_s),
        unloading_over_loading=(fall / unloading_s) / (rise / loading_s) if unloading_s > 0.0 else math.inf,
    )
