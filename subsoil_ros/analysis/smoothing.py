"""Moving means of series."""

import numpy as np
from numpy.typing import NDArray

from .series import Series


def running_mean(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Centred mean over `count` (made odd) values, over fewer at the ends; (n,) -> (n,)."""
    half = min(count // 2, (len(values) - 1) // 2)
    if half < 1:
        return values
    kernel = np.ones(2 * half + 1)
    return np.convolve(values, kernel, "same") / np.convolve(np.ones_like(values), kernel, "same")


def moving_mean(series: Series, name: str, seconds: float) -> NDArray[np.float64]:
    """Centred mean over a time [s] of a column (n,); the column itself where rows are farther apart."""
    return running_mean(series[name], max(1, round(seconds / step_s(series, seconds))))


def step_s(series: Series, otherwise_s: float = 1.0) -> float:
    """Time from row to row [s]; `otherwise_s` for a single row."""
    times = series["time_s"]
    return float(np.median(np.diff(times))) if len(times) > 1 else otherwise_s
