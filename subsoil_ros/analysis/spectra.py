"""Spectra with confidence: Welch's estimate, its chi-square interval, and a test against red noise.

Welch (IEEE Trans. Audio Electroacoust. 15 (1967) 70-73): means over segments that overlap by half. With K
segments under the window w, D apart, the relative variance is

    V = (1 + 2 sum_m (1 - m / K) r(m)) / K,   r(m) = (sum_n w_n w_{n + m D})^2 / (sum_n w_n^2)^2

and nu = 2 / V degrees of freedom; nu P / chi2 is the interval. What stands out does so against
autoregressive processes of first order with the variance of the series (C. Torrence, G.P. Compo, Bull. Amer.
Meteor. Soc. 79 (1998) 61-78, eq. 16), at 95 % for all frequencies together (Bonferroni). One has the lag-one
correlation r of the series, as there. Where quick noise rides on a slow drift, r describes the noise, and the
drift would be taken for a peak. So the other has the integrated correlation time of the series, tau steps:
r = (2 tau - 1) / (2 tau + 1). The larger of the two densities counts.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .series import write_table_csv
from .stationarity import correlation_steps

SEGMENTS = 4
"""Lengths of a segment in the record: 7 half-overlapping ones; more would resolve low frequencies worse."""

LEAST_ROWS = 64
"""Least length of a record that gets a spectrum: 16 values a segment."""

SLOWEST = 2
"""Row of the lowest frequency that is evaluated: the number of its periods in a segment."""

CONFIDENCE = 0.95

HANN_BINS = 1.5
"""Equivalent noise bandwidth of Hann's window in bins: two tones nearer than this are one."""


@dataclass(frozen=True)
class Spectrum:
    """One-sided power density of a series about its trend; arrays (m,)."""

    frequency_hz: NDArray[np.float64]
    density: NDArray[np.float64]  # unit of the series squared per hertz
    low: NDArray[np.float64]  # 95 % interval of the density
    high: NDArray[np.float64]
    noise: NDArray[np.float64]  # of red noise, the larger of two
    level: NDArray[np.float64]  # exceeded by red noise, at any frequency, in one record of twenty
    degrees_of_freedom: float
    resolution_hz: float

    @property
    def dominant(self) -> int:
        """Row of the largest density, among frequencies of which a segment has two periods or more."""
        return SLOWEST + int(np.argmax(self.density[SLOWEST:]))

    @property
    def dominant_hz(self) -> float:
        """Frequency of the largest density."""
        return float(self.frequency_hz[self.dominant])

    @property
    def significant(self) -> bool:
        """Whether the dominant frequency stands out of red noise."""
        return bool(self.density[self.dominant] > self.level[self.dominant])


def spectrum(step_s: float, values: NDArray[np.float64]) -> Spectrum | None:
    """Estimate the spectrum of values (n,), `step_s` [s] apart; None for a short or constant record."""
    count = len(values)
    if count < LEAST_ROWS:
        return None
    from scipy.signal import welch  # slow to import; short records need none of it
    from scipy.special import gammaincinv

    place = np.arange(count)
    about = values - np.polyval(np.polyfit(place, values, 1), place)
    variance = float(about.var())
    if variance <= 1e-24 * float(np.max(np.abs(values))) ** 2:  # round-off of a constant
        return None
    length = count // SEGMENTS
    frequency, density = welch(
        about, 1.0 / step_s, "hann", nperseg=length, noverlap=length // 2, detrend="constant"
    )
    nu = degrees_of_freedom(count, length)

    def quantile(p: float) -> float:
        """Quantile of the chi-square distribution over its mean."""
        return 2.0 * float(gammaincinv(0.5 * nu, p)) / nu

    tail = 0.5 * (1.0 - CONFIDENCE)
    lag_one = float(about[1:] @ about[:-1] / (about @ about))
    steps = correlation_steps(about)
    noise = np.maximum(
        *(
            variance * red_noise(frequency, step_s, correlation)
            for correlation in (lag_one, (2.0 * steps - 1.0) / (2.0 * steps + 1.0))
        )
    )
    return Spectrum(
        frequency_hz=frequency,
        density=density,
        low=density / quantile(1.0 - tail),
        high=density / quantile(tail),
        noise=noise,
        level=noise * quantile(1.0 - (1.0 - CONFIDENCE) / len(frequency)),
        degrees_of_freedom=nu,
        resolution_hz=HANN_BINS * float(frequency[1]),
    )


def red_noise(frequency_hz: NDArray[np.float64], step_s: float, correlation: float) -> NDArray[np.float64]:
    """One-sided density [1/Hz] of an autoregressive process of first order with unit variance.

    Args:
        correlation: of neighbouring values.
    """
    turn = np.cos(2.0 * np.pi * frequency_hz * step_s)
    return 2.0 * step_s * (1.0 - correlation**2) / (1.0 + correlation**2 - 2.0 * correlation * turn)


def degrees_of_freedom(count: int, length: int) -> float:
    """Degrees of freedom of Welch's estimate: `count` values, half-overlapping Hann segments of `length`."""
    hop = length - length // 2
    segments = 1 + (count - length) // hop
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    power = float(window @ window)
    variance = 1.0
    for m in range(1, segments):
        if m * hop >= length:
            break
        overlap = float(window[m * hop :] @ window[: length - m * hop]) / power
        variance += 2.0 * (1.0 - m / segments) * overlap**2
    return 2.0 * segments / variance


def write_spectra_csv(spectra: dict[str, Spectrum], path: Path) -> None:
    """One row for each frequency of each quantity; densities in the quantity's unit squared per hertz."""
    columns: dict[str, Iterable[object]] = {
        "quantity": [name for name, found in spectra.items() for _ in found.frequency_hz]
    }
    for kind in ("frequency_hz", "density", "low", "high", "noise", "level"):
        name = "red_noise" if kind == "noise" else kind
        columns[name] = np.concatenate([getattr(found, kind) for found in spectra.values()])
    write_table_csv(columns, path)
