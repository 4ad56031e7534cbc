"""Whether a stretch of a run is steady, and how well its mean is known.

Neighbouring samples of a draft are correlated, and those of one failure cycle balance each other: after a
peak comes a fall. Only slower fluctuations make the mean uncertain. So its error comes from the slowest waves
of the stretch (equal-weighted cosine estimator of E. Lazarus, D.J. Lewis, J.H. Stock, M.W. Watson,
J. Bus. Econ. Stat. 36 (2018) 541-559):

    c_k = sqrt(2 / n) sum_i x_i cos(pi k (i - 1/2) / n),   error^2 = sum_(k = 1..WAVES) c_k^2 / (WAVES n)

with Student's t of WAVES degrees of freedom. The standard error of the trend's slope is the one of least
squares of as many independent samples, from the waves 2 to WAVES + 1 of the residuals: the first is the
trend's own. How long the stretch is beside the integrated autocorrelation time

    tau = step (1/2 + sum_k rho_k),   summed up to the first lag M >= 5 tau / step

(automatic window of N. Madras, A.D. Sokal, J. Stat. Phys. 50 (1988) 109-186) decides if it is judged.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .intervals import CONFIDENCE, t_quantile

WAVES = 8
"""Number of slowest waves that the error comes from. With 8, 95 % intervals hold the mean of a random process
in 90 % of stretches ten correlation times long, and the fastest wave, WAVES / 2 over the stretch, is slower
than failure cycles in any stretch of ten. `python -m validation.field coverage` measures it on drafts."""

WINDOW_FACTOR = 5.0
"""Lags per autocorrelation time that are summed: a bias of e^-5 (Madras and Sokal)."""

LEAST_EFFECTIVE = 8.0
"""Length of a stretch over 2 tau below which no trend is judged: as many independent samples as WAVES."""

BLOCKS = 4
"""Blocks whose means are shown: in a window of 4 s, each is longer than a cycle of the paper."""


@dataclass(frozen=True)
class Stationarity:
    """Mean, trend and blocks of one quantity over a window; half-widths are of 95 %."""

    mean: float
    mean_error: float  # standard error
    correlation_s: float  # integrated autocorrelation time
    effective_count: float  # independent samples that would give the mean with the same error
    length_over_correlation: float  # over 2 tau about the trend, which the verdict rests on
    slope_per_s: float
    slope_half_width_per_s: float
    length_s: float
    deviation: float  # standard deviation about the trend
    deviation_half_width: float
    block_means: tuple[float, ...]

    @property
    def mean_half_width(self) -> float:
        """Half-width of the 95 % interval of the mean."""
        return self.half_width()

    def half_width(self, confidence: float = CONFIDENCE) -> float:
        """Half-width of the interval of the mean, at another confidence."""
        return self.mean_error * t_quantile(WAVES, confidence)

    @property
    def drift(self) -> float:
        """Change along the trend over the window, relative to the mean."""
        return self.slope_per_s * self.length_s / abs(self.mean) if self.mean else math.inf

    @property
    def drift_half_width(self) -> float:
        """Half-width of the 95 % interval of `drift`."""
        return self.slope_half_width_per_s * self.length_s / abs(self.mean) if self.mean else math.inf

    @property
    def verdict(self) -> str:
        """`drifts` (the trend's interval leaves zero out), `no drift seen`, or `too short`."""
        if self.length_over_correlation < LEAST_EFFECTIVE:
            return "too short"
        return "drifts" if abs(self.slope_per_s) > self.slope_half_width_per_s else "no drift seen"


def _about_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differences (n,) from the mean; exactly zero for a constant, whose mean is rounded."""
    return values - values.mean() if np.ptp(values) > 0.0 else np.zeros(len(values))


def correlation_steps(values: NDArray[np.float64]) -> float:
    """Integrated autocorrelation time of (n,) values in steps; 1/2 for independent ones."""
    about = _about_mean(values)
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


def _long_run_variance(about: NDArray[np.float64], first: int) -> float:
    """n times the variance of the mean of (n,) values, from WAVES waves, the slowest being number `first`."""
    waves = np.arange(first, first + WAVES)[:, None]
    places = (np.arange(len(about)) + 0.5) / len(about)
    found = np.cos(np.pi * waves * places) @ about
    return float(found @ found) * 2.0 / len(about) / WAVES


def stationarity(times_s: NDArray[np.float64], values: NDArray[np.float64]) -> Stationarity | None:
    """Judge values (n,) at evenly spaced times (n,) [s]; None for fewer than 2 WAVES values."""
    count = len(values)
    if count < 2 * WAVES:
        return None
    step_s = float(np.median(np.diff(times_s)))
    centred = times_s - times_s.mean()
    about = _about_mean(values)
    spread = float(centred @ centred)
    slope = float(centred @ about) / spread
    residual = about - slope * centred
    of_mean, of_trend = _long_run_variance(about, 1), _long_run_variance(residual, 2)
    variance = float(about @ about) / (count - 1)
    square = residual**2
    deviation = math.sqrt(square.mean())
    of_square = math.sqrt(_long_run_variance(square - square.mean(), 1) / count) * t_quantile(WAVES)
    return Stationarity(
        mean=float(values.mean()),
        mean_error=math.sqrt(of_mean / count),
        correlation_s=correlation_steps(values) * step_s,
        effective_count=count * variance / of_mean if of_mean > 0.0 else float(count),
        length_over_correlation=count / (2.0 * correlation_steps(residual)),
        slope_per_s=slope,
        slope_half_width_per_s=math.sqrt(of_trend / spread) * t_quantile(WAVES),
        length_s=count * step_s,
        deviation=deviation,
        deviation_half_width=0.5 * of_square / deviation if deviation > 0.0 else 0.0,
        block_means=tuple(float(block.mean()) for block in np.array_split(values, BLOCKS)),
    )
