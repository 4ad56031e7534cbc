"""Fluctuation of a draft along the travel, and a fit of wedges to it."""

import math
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import digamma

from ..wedge.failure_wedge import block_number, block_sizes, mean_bearing

Values = NDArray[np.float64]

SAMPLE_M = 1e-3
"""Travel between samples of a spectrum: a twentieth of a particle's diameter of 20 mm."""

RESOLVED_WAVES = 4.0
"""Least number of waves in the window: longer waves count as drift, as too few fit in to estimate a power."""

MEAN_LENGTHS_M = (0.1, 0.3)
"""Travel of the means whose variance is compared: about that of one failure, and of several."""

DEVIATES, QUADRATURE = 4.0, 201
"""Range in standard deviations, and points, of the quadrature over lengths. With these and WAVES, powers by
octave are those of simulated wedges within 9 % (tests/physics/test_wedge_fluctuation.py)."""

QUANTILES = (0.01, 0.99)
"""Parts of the travel on which the draft is below the ends of its range: peaks count for what they load."""

BINS = 500
"""Of forces, in the distribution of the sum of the blocks'."""

MOST_BLOCKS = 50
"""At the largest depth of a fit: with more, the draft is a normal variable to 4 %, and the model slower."""

WAVES = 8
"""Wavelengths an octave at which the spectrum is summed, 9 % apart; for their accuracy see DEVIATES."""

MODEL_ERROR = 0.3
"""Error of the model in the logarithm of a power, added to the statistical one: a factor of 1.35."""

ENDS_ERROR = 0.15
"""Error of the logarithm of an end of the range: 0.05 is its scatter between windows of 5 m of simulated
wedges, 0.1 the model's."""

HANN_VARIANCE = 35.0 / 18.0
"""Relative variance of a power summed over n frequencies of a Hann window, times n: neighbours correlate, 1 +
2 (2/3)^2 + 2 (1/6)^2."""

SMALL_PART = 0.01
"""Part of the variance that is added to each octave's power: octaves with less then have little weight."""


class Wedges(NamedTuple):
    """Wedges whose blocks fail one by one."""

    blocks: float  # of one size; the last one may be a fraction
    gradual: bool  # how they fail
    drop: float  # part of its force that a block loses
    length_variation: float  # of the travel from failure to failure, relative
    length_m: float  # its mean


class Fluctuation(NamedTuple):
    """What is fitted of the draft of a pull, about its trend.

    Few blocks that lose much have the power of many that lose little, but other ends.
    """

    depth_m: float
    power: Values  # (octaves,) over the square of the mean draft
    ends_over_deviation: Values  # (2,)
    inertia: float  # of the soil, over what the blocks bear together just before they fail
    replicates: int = 1  # that power and ends are means of


def octave_edges_m(shortest_m: float, window_m: float) -> Values:
    """Edges (n + 1,) of the octaves of wavelength that a window resolves, from the shortest on."""
    count = int(math.log2(window_m / RESOLVED_WAVES / shortest_m) + 1e-9)
    return np.asarray(shortest_m * 2.0 ** np.arange(max(count, 1) + 1), np.float64)


def without_trend(sampled: Values) -> Values:
    """Samples (n,) less their linear trend."""
    at = np.arange(len(sampled))
    return sampled - np.polyval(np.polyfit(at, sampled, 1), at)


def octave_power(about: Values, shortest_m: float) -> Values:
    """Part of the variance of samples (n,) SAMPLE_M apart in each octave of octave_edges_m, (octaves,).

    By a periodogram with a Hann window; by Parseval's theorem the parts of all waves add up to the variance.
    """
    window = np.hanning(len(about))
    power = 2.0 * np.abs(np.fft.rfft(about * window)) ** 2 / (window @ window) / len(about)
    frequency = np.fft.rfftfreq(len(about), SAMPLE_M)
    edges = octave_edges_m(shortest_m, len(about) * SAMPLE_M)
    inside = [(frequency > 1.0 / long) & (frequency <= 1.0 / short) for short, long in pairwise(edges)]
    return np.array([power[rows].sum() for rows in inside])


def variance_of_means(about: Values, length_m: float) -> float:
    """Variance of the moving mean over `length_m` of samples (n,) SAMPLE_M apart."""
    count = min(round(length_m / SAMPLE_M), len(about))
    sums = np.cumsum(np.concatenate([[0.0], about]))
    return float(np.var((sums[count:] - sums[:-count]) / count))


def ends_over_deviation(about: Values) -> Values:
    """(2,) how far QUANTILES of samples (n,) are below and above their mean, over their standard deviation.

    2.33 and 2.33 if the samples are normal, 1.70 and 1.70 if they are even.
    """
    low, high = np.quantile(about, QUANTILES) - about.mean()
    return np.array([-low, high]) / about.std()


def bearing_ends(wedges: Wedges) -> Values:
    """ends_over_deviation of the resistance of `bearing_power` along the travel."""
    edges, sizes = np.linspace(0.0, 1.0, BINS + 1), block_sizes(wedges.blocks)
    folded = np.ones(BINS + 1, complex)
    for size, count in Counter(sizes).items():
        back = np.minimum(edges / size, 1.0)  # of what it loses, at each edge: drop has no part in the ratio
        below = np.sqrt(back) if wedges.gradual else back  # part of the travel on which it bears less
        folded = folded * np.fft.rfft(np.diff(below), 2 * BINS) ** count
    together = np.fft.irfft(folded, 2 * BINS)[: BINS + len(sizes)]
    place = np.arange(len(together)) / BINS  # of the middles of bins, up to a constant
    low, high = np.interp(QUANTILES, np.cumsum(together), place + 0.5 / BINS)
    mean = together @ place
    return np.array([mean - low, high - mean]) / math.sqrt(together @ (place - mean) ** 2)


def bearing_power(wedges: Wedges, shortest_m: float, window_m: float) -> Values:
    """Power by octave (octaves,) of the soil's resistance along the travel, over the square of its mean.

    A block of length L bears g(u) = `bearing`(u / L) at 0 <= u < L of its travel; L is lognormal of mean
    length_m, independent from failure to failure and from block to block, as in the engine. With G the
    Fourier transform of g and c = E[exp(-i w L)], the two-sided spectral density of a block is that of pulses
    laid end to end,
    (E|G|^2 + 2 Re(E[conj(G) exp(-i w L)] E[G] / (1 - c))) / E[L]; densities of the blocks add up.
    """
    deviate = np.linspace(-DEVIATES, DEVIATES, QUADRATURE)
    weight = np.exp(-0.5 * deviate**2)
    weight /= weight.sum()
    sigma = math.sqrt(math.log1p(wedges.length_variation**2))
    length = wedges.length_m * np.exp(sigma * deviate - 0.5 * sigma**2)
    edges = octave_edges_m(shortest_m, window_m)
    wave = np.geomspace(edges[0], edges[-1], WAVES * (len(edges) - 1) + 1)
    wave = np.sqrt(wave[1:] * wave[:-1]).reshape(-1, 1)
    frequency = 2.0 * np.pi / wave  # w [rad/m]
    turned = np.exp(-1j * frequency * length)
    even = (1.0 - turned) / (1j * frequency)
    half = 0.5 * frequency * length
    if wedges.gradual:  # of (2 u / L - 1)^2
        even_in_half = np.sin(half) / half + 2.0 / half**2 * (np.cos(half) - np.sin(half) / half)
        back = np.exp(-1j * half) * length * even_in_half
    else:  # of u / L
        back = (even - turned * length) / (1j * frequency * length)
    pulse = (1.0 - wedges.drop) * even + wedges.drop * back

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((values * weight).sum(axis=1))  # far faster than a matrix product on busy cores

    alone = mean(np.abs(pulse) ** 2).real
    among = 2.0 * np.real(mean(np.conj(pulse) * turned) * mean(pulse) / (1.0 - mean(turned)))
    density = (alone + among) / wedges.length_m
    share = 2.0 * density / wave[:, 0] * math.log(2.0) / WAVES  # 2 S df, df = f d(ln f)
    relative = share.reshape(-1, WAVES).sum(axis=1) / mean_bearing(wedges.drop, wedges.gradual) ** 2
    return np.asarray(relative * adding_up(wedges.blocks))


def adding_up(blocks: float) -> float:
    """Variance of what blocks bear together, each failing by itself, over that of one in their place."""
    return sum(size**2 for size in block_sizes(blocks))


def mean_logarithm(shortest_m: float, window_m: float, windows: int) -> Values:
    """Mean logarithm (octaves,) of the powers of octave_power, as means over `windows`, over the true powers.

    A power that is estimated from few waves is about as often below 2/3 of the truth as above 3/2; its
    logarithm is too small on average. With k degrees of freedom it is digamma(k / 2) - ln(k / 2) (M.S.
    Bartlett, D.G. Kendall, Suppl. J. R. Stat. Soc. 8 (1946) 128-138); an octave of n frequencies has 2 n /
    HANN_VARIANCE.
    """
    edges = octave_edges_m(shortest_m, window_m)
    half = windows * window_m * (1.0 / edges[:-1] - 1.0 / edges[1:]) / HANN_VARIANCE
    return np.asarray(digamma(half) - np.log(half))


def fit_wedges(
    pulls: Sequence[Fluctuation],
    gradual: bool,
    length_scale_m: Sequence[float],
    shortest_m: float,
    window_m: float,
) -> tuple[Wedges, float, float]:
    """Fit wedges to the fluctuation of pulls by least squares. The lag of spring and rate is left out.

    Args:
        pulls: (n,)
        gradual: how blocks fail.
        length_scale_m: (n,) the length of a pull's wedges is this times the `length_m` that is returned.
        shortest_m: wave of the first octave.
        window_m: travel of a pull.

    Returns:
        Wedges of one block, the depth up to which a wedge is one block [m], and the cost.
    """
    edges = octave_edges_m(shortest_m, window_m)
    statistical = np.sqrt(np.sqrt(edges[1:] * edges[:-1]) / window_m)
    weight = 1.0 / (MODEL_ERROR + statistical)
    deepest = max(pull.depth_m for pull in pulls)

    def wedges_of(found: Values) -> tuple[Wedges, float]:
        odds, length, spread, size = found.tolist()
        drop = 1.0 / (1.0 + math.exp(-odds))
        return Wedges(1.0, gradual, drop, math.exp(spread), math.exp(length)), math.exp(size)

    def residuals(found: Values) -> Values:
        rows, (wedges, size) = [], wedges_of(found)
        alone = {  # powers of one block, for each length once
            scale: bearing_power(wedges._replace(length_m=scale * wedges.length_m), shortest_m, window_m)
            for scale in set(length_scale_m)
        }
        bears = mean_bearing(wedges.drop, gradual)
        for pull, scale in zip(pulls, length_scale_m, strict=True):
            here = wedges._replace(blocks=block_number(pull.depth_m, size))
            model = alone[scale] * adding_up(here.blocks) * (bears / (bears + pull.inertia)) ** 2
            floor = SMALL_PART * pull.power.sum()
            low_by = mean_logarithm(shortest_m, window_m, pull.replicates)
            rows.append(weight * (np.log((model + floor) / (pull.power + floor)) + low_by))
            rows.append(np.log(bearing_ends(here) / pull.ends_over_deviation) / ENDS_ERROR)
        return np.concatenate(rows)

    shortest, longest = 2.0 * shortest_m / max(length_scale_m), 0.5 * window_m / min(length_scale_m)
    lower = np.array([-5.0, math.log(shortest), math.log(0.1), math.log(deepest / MOST_BLOCKS**0.5)])
    upper = np.array([4.0, math.log(longest), math.log(3.0), math.log(deepest)])
    ends = [
        least_squares(
            residuals,
            [
                1.0,
                (1.0 - long) * lower[1] + long * upper[1],
                math.log(0.6),
                (1.0 - big) * lower[3] + big * upper[3],
            ],
            bounds=(lower, upper),
            ftol=1e-3,
            max_nfev=50,
        )
        for long in (0.25, 0.5)
        for big in (0.3, 0.6)
    ]
    best = min(ends, key=lambda end: float(end.cost))
    return *wedges_of(best.x), float(best.cost)
