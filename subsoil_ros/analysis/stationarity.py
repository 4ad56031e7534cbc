"""Whether a stretch of a run is steady, and how well its mean is known.

Neighbouring samples of a draft hang together, so n of them tell as little as n_eff = T / (2 tau) independent
ones, tau being the integrated autocorrelation time

    tau = step (1/2 + sum_k rho_k),   summed up to the first lag M >= 5 tau / step

(automatic window of N. Madras, A.D. Sokal, J. Stat. Phys. 50 (1988) 109-186). The standard error of the mean
is s / sqrt(n_eff); that of the trend's slope is the one of least squares times sqrt(2 tau / step), tau here
of the residuals. Intervals are Student's with n_eff - 2 degrees of freedom.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .intervals import t_quantile

WINDOW_FACTOR = 5.0
"""Lags per autocorrelation time that are summed: a bias of e^-5 (Madras and Sokal)."""

LEAST_EFFECTIVE = 8.0
"""Fewer independent samples judge no trend (chosen: Student's factor is then above 2.4)."""

BLOCKS = 4
"""Blocks whose means are shown (chosen: each still longer than a cycle of the paper in 4 s)."""


@dataclass(frozen=True)
class Stationarity:
    """Mean, trend and blocks of one quantity over a window; half-widths are of 95 %."""

    mean: float
    mean_error: float  # standard error, of samples that hang together
    correlation_s: float  # integrated autocorrelation time
    effective_count: float  # independent samples about the mean
    effective_count_about_trend: float  # and about the trend, which the verdict rests on
    slope_per_s: float
    slope_half_width_per_s: float
    length_s: float
    block_means: tuple[float, ...]

    @property
    def mean_half_width(self) -> float:
        """Of the interval of the mean; infinite where two samples or fewer are independent."""
        return self.mean_error * t_quantile(self.effective_count - 1.0)

    @property
    def drift(self) -> float:
        """Change along the trend over the window, relative to the mean."""
        return self.slope_per_s * self.length_s / abs(self.mean) if self.mean else math.inf

    @property
    def drift_half_width(self) -> float:
        """Of `drift`."""
        return self.slope_half_width_per_s * self.length_s / abs(self.mean) if self.mean else math.inf

    @property
    def verdict(self) -> str:
        """`drifts` (the trend's interval leaves zero out), `no drift seen`, or `too short`."""
        if self.effective_count_about_trend < LEAST_EFFECTIVE:
            return "too short"
        return "drifts" if abs(self.slope_per_s) > self.slope_half_width_per_s else "no drift seen"


def correlation_steps(values: NDArray[np.float64]) -> float:
    """Integrated autocorrelation time of (n,) values in steps; 1/2 for independent ones."""
    about = values - values.mean()
    count = len(about)
    size = 2 ** math.ceil(math.log2(2 * count))
    spectrum = np.abs(np.fft.rfft(about, size)) ** 2
    covariance = np.fft.irfft(spectrum, size)[:count]
    if covariance[0] <= 0.0:  # a constant
        return 0.5
    times = 0.5 + np.cumsum(covariance[1:] / covariance[0])
    lags = np.arange(1, count)
    closed = np.flatnonzero(lags >= WINDOW_FACTOR * times)
    found = float(times[closed[0]] if len(closed) else times[-1])
    return max(found, 0.5)


def stationarity(times_s: NDArray[np.float64], values: NDArray[np.float64]) -> Stationarity | None:
    """Of values (n,) at even times (n,) [s]; None for fewer than 2 BLOCKS of them."""
    count = len(values)
    if count < 2 * BLOCKS:
        return None
    step_s = float(np.median(np.diff(times_s)))
    tau = correlation_steps(values)
    effective = count / (2.0 * tau)
    centred = times_s - times_s.mean()
    about = values - values.mean()
    spread = float(centred @ centred)
    slope = float(centred @ about) / spread
    residual = about - slope * centred
    tau_residual = correlation_steps(residual)
    variance = float(residual @ residual) / (count - 2) / spread * 2.0 * tau_residual
    about_trend = count / (2.0 * tau_residual)
    factor = t_quantile(about_trend - 2.0)
    return Stationarity(
        mean=float(values.mean()),
        mean_error=float(values.std(ddof=1)) / math.sqrt(effective),
        correlation_s=tau * step_s,
        effective_count=effective,
        effective_count_about_trend=about_trend,
        slope_per_s=slope,
        slope_half_width_per_s=math.sqrt(variance) * factor if variance > 0.0 else 0.0,
        length_s=count * step_s,
        block_means=tuple(float(block.mean()) for block in np.array_split(values, BLOCKS)),
    )
