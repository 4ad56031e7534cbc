"""Moving means of series."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .columns import TIME
from .series import Series

Columns = Series | Mapping[str, NDArray[Any]]
"""Columns by name, each (n,), with time_s among them."""


def running_mean(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Centred mean over `count` (made odd) values, over fewer at the ends, nan left out; (n,) -> (n,)."""
    half = min(count // 2, (len(values) - 1) // 2)
    if half < 1:
        return values
    known, window = ~np.isnan(values), np.ones(2 * half + 1)
    total = np.convolve(np.where(known, values, 0.0), window, "same")
    number = np.convolve(known, window, "same")
    return np.divide(total, number, out=np.full(len(values), np.nan), where=number > 0.0)


def moving_mean(columns: Columns, name: str, seconds: float) -> NDArray[np.float64]:
    """Centred mean of a column (n,) over `seconds`; the column itself where rows are farther apart."""
    return running_mean(columns[name], max(1, round(seconds / step_s(columns, seconds))))


def step_s(columns: Columns, otherwise_s: float = 1.0) -> float:
    """Time from row to row [s]; `otherwise_s` for a single row."""
    times = columns[TIME]
    return float(np.median(np.diff(times))) if len(times) > 1 else otherwise_s
