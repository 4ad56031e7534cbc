"""Confidence intervals over bed seeds: Student's t, on differences of the same seed where there are pairs.

Source: Student, Biometrika 6 (1908) 1-25; any textbook, e.g. NIST/SEMATECH e-Handbook 1.3.5.2 and 1.3.5.3.
Assumed: seeds are independent and their means near normal, which three seeds cannot test. With three seeds
the interval is wide: t(2) is 4.3 standard errors at 95 %.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

CONFIDENCE = 0.95

NO_SCATTER = 1e-9
"""Half-width over the value, up to which an interval is rounding alone. Then nothing scatters, as in seeds
that change nothing, and what another field would give is not known."""


@dataclass(frozen=True)
class Interval:
    """A mean and the half-width of its confidence interval; nan where a single value has no scatter."""

    mean: float
    half_width: float
    count: int

    @property
    def low(self) -> float:
        """Lower end."""
        return self.mean - self.half_width

    @property
    def high(self) -> float:
        """Upper end."""
        return self.mean + self.half_width

    @property
    def resolved(self) -> bool:
        """Whether the interval excludes zero: the difference is more than the scatter of the seeds."""
        return abs(self.mean) > self.half_width  # False where the half-width is not known

    @property
    def scatters(self) -> bool:
        """Whether the values differ by more than rounding."""
        return self.half_width > NO_SCATTER * abs(self.mean)  # False where the half-width is not known

    def text(self, digits: str) -> str:
        """Mean and half-width, which is never rounded to zero; the mean alone where nothing scatters."""
        if not self.scatters:
            return f"{self.mean:{digits}}"
        half = f"{self.half_width:{digits.lstrip('+')}}"
        return f"{self.mean:{digits}} +- {half if float(half) else f'{self.half_width:.1g}'}"

    def scaled(self, factor: float) -> "Interval":
        """Interval of the mean times a factor."""
        return Interval(factor * self.mean, abs(factor) * self.half_width, self.count)


def mean_interval(values: Sequence[float], confidence: float = CONFIDENCE) -> Interval:
    """Mean of values with its interval: mean +- t(n - 1) s / sqrt(n); unknown (nan) for a single value."""
    from scipy.stats import ttest_1samp

    if not len(values):
        return Interval(math.nan, math.nan, 0)
    with warnings.catch_warnings():  # of scipy, where there is one value or all are equal
        warnings.simplefilter("ignore", RuntimeWarning)
        ends = ttest_1samp(values, 0.0).confidence_interval(confidence)
    return Interval(float(np.mean(values)), 0.5 * float(ends.high - ends.low), len(values))


def t_quantile(freedoms: float, confidence: float = CONFIDENCE) -> float:
    """Half-width of a two-sided interval in standard errors; infinite without a degree of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedoms, 0.5 + 0.5 * confidence)) if freedoms > 0.0 else math.inf


def difference_by_seed(
    values: dict[int, float], reference: dict[int, float], confidence: float = CONFIDENCE
) -> Interval:
    """Mean of value - reference over the seeds (keys) that both have."""
    seeds = sorted(values.keys() & reference.keys())
    return mean_interval([values[seed] - reference[seed] for seed in seeds], confidence)


def error_by_seed(
    values: dict[int, float], reference: dict[int, float], confidence: float = CONFIDENCE
) -> Interval:
    """Mean of values over the mean of the reference, less 1, over the seeds (keys) that both have.

    The ratio estimator R of W.G. Cochran, Sampling Techniques, 3rd ed. (Wiley 1977), section 6.3: its error
    is that of the mean of (value - R reference) / mean reference: the scatter of the reference counts too.
    """
    seeds = sorted(values.keys() & reference.keys())
    if not seeds:
        return Interval(math.nan, math.nan, 0)
    mean = float(np.mean([reference[seed] for seed in seeds]))
    ratio = float(np.mean([values[seed] for seed in seeds])) / mean
    left = mean_interval([(values[seed] - ratio * reference[seed]) / mean for seed in seeds], confidence)
    return Interval(math.copysign(1.0, mean) * (ratio - 1.0), left.half_width, left.count)


def error_against_one(
    values: Sequence[float],
    reference: float,
    scatter: float,
    scatter_count: int,
    confidence: float = CONFIDENCE,
) -> Interval:
    """Mean of n values over a single reference, less 1; the reference has the seed scatter of other runs.

    Variance of the mean, s^2 / n, plus the ratio's square times that of the one reference run, scatter^2. As
    many freedoms as the smaller of both samples has: fewer than both together, so on the safe side.

    Args:
        scatter: standard deviation over the seeds, of `scatter_count` other runs.
    """
    own = mean_interval(values, confidence)
    error = (own.mean - reference) / abs(reference)
    count = min(own.count, scatter_count)
    if count < 2:
        return Interval(error, math.nan, own.count)
    deviation = math.hypot(
        float(np.std(values, ddof=1)) / math.sqrt(own.count), own.mean / reference * scatter
    )
    return Interval(error, t_quantile(count - 1, confidence) * deviation / abs(reference), own.count)
