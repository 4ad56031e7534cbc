"""Fluctuation of a draft along the travel, and a fit of wedges to it."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ...wedge.engine import LARGEST_DROP

Values = NDArray[np.float64]

SAMPLE_M = 1e-3
"""Travel between samples of a spectrum: a twentieth of a particle's diameter of 20 mm."""

RESOLVED_WAVES = 4.0
"""Least number of waves in the window: longer waves count as drift, as too few fit in to estimate a power."""

MEAN_LENGTHS_M = (0.1, 0.3)
"""Travel of the means whose variance is compared: about that of one failure, and of several."""

DEVIATES, QUADRATURE = 4.0, 201
"""Range in standard deviations, and points, of the quadrature over lengths. With these and WAVES, powers by
octave are those of simulated wedges within 12 % (tests/verification/test_wedge_fluctuation.py)."""

WAVES = 8
"""Wavelengths an octave at which the spectrum is summed, 9 % apart; for their accuracy see DEVIATES."""

MODEL_ERROR = 0.3
"""Error of the model in the logarithm of a power, added to the statistical one: a factor of 1.35."""

SMALL_PART = 0.01
"""Part of the variance that is added to each octave's power: octaves with less then have little weight."""


class Wedges(NamedTuple):
    """Parameters of wedges that vary."""

    drop: float  # part of the force lost at failure
    variation: float  # of the strength, relative
    length_variation: float  # relative
    length_m: float  # mean


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


def bearing_power(wedges: Wedges, shortest_m: float, window_m: float) -> Values:
    """Power by octave (octaves,) of the soil's resistance along the travel, over the square of its mean.

    A wedge of strength S and length L bears g(u) = S (1 - drop (1 - u / L)) at 0 <= u < L of its travel; S
    and L are lognormal of mean 1 and length_m, independent from wedge to wedge, as in the engine.
    With G the Fourier transform of g and c = E[exp(-i w L)], the two-sided spectral density is that of pulses
    laid end to end, (E|G|^2 + 2 Re(E[conj(G) exp(-i w L)] E[G] / (1 - c))) / E[L].
    """
    deviate = np.linspace(-DEVIATES, DEVIATES, QUADRATURE)
    weight = np.exp(-0.5 * deviate**2)
    weight /= weight.sum()
    heavy = weight.astype(complex)
    sigma = math.sqrt(math.log1p(wedges.length_variation**2))
    length = wedges.length_m * np.exp(sigma * deviate - 0.5 * sigma**2)
    edges = octave_edges_m(shortest_m, window_m)
    wave = np.geomspace(edges[0], edges[-1], WAVES * (len(edges) - 1) + 1)
    wave = np.sqrt(wave[1:] * wave[:-1]).reshape(-1, 1)
    frequency = 2.0 * np.pi / wave  # w [rad/m]
    turned = np.exp(-1j * frequency * length)
    even = (1.0 - turned) / (1j * frequency)
    rising = (even - turned * length) / (1j * frequency * length)  # of u / L
    pulse = (1.0 - wedges.drop) * even + wedges.drop * rising

    def mean(values: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(values @ heavy)

    alone = (1.0 + wedges.variation**2) * mean(np.abs(pulse) ** 2).real
    among = 2.0 * np.real(mean(np.conj(pulse) * turned) * mean(pulse) / (1.0 - mean(turned)))
    density = (alone + among) / wedges.length_m
    share = 2.0 * density / wave[:, 0] * math.log(2.0) / WAVES  # 2 S df, df = f d(ln f)
    return np.asarray(share.reshape(-1, WAVES).sum(axis=1) / (1.0 - 0.5 * wedges.drop) ** 2)


def fit_wedges(
    relative_power: Sequence[Values],
    length_scale_m: Values,
    part: Values,
    shortest_m: float,
    window_m: float,
) -> tuple[Wedges, float]:
    """Fit wedges to the draft's fluctuation at several points by least squares; return them and the cost.

    Args:
        relative_power: of the draft over its mean, by octave, (octaves,) for each point.
        length_scale_m: of each point; the length of its wedges is this times `length_m`.
        part: of drop and variation that acts at each point.
    """
    edges = octave_edges_m(shortest_m, window_m)
    statistical = np.sqrt(np.sqrt(edges[1:] * edges[:-1]) / window_m)
    weight = 1.0 / (MODEL_ERROR + statistical)

    def wedges_of(found: Values) -> Wedges:
        return Wedges(float(1.0 / (1.0 + np.exp(-found[0]))), *np.exp(found[1:]).tolist())

    def residuals(found: Values) -> Values:
        rows = []
        for power, scale, acts in zip(relative_power, length_scale_m, part, strict=True):
            wedges = wedges_of(found)
            drop = min(acts * wedges.drop, LARGEST_DROP)
            here = Wedges(drop, acts * wedges.variation, wedges.length_variation, scale * wedges.length_m)
            model = bearing_power(here, shortest_m, window_m)
            floor = SMALL_PART * power.sum()
            rows.append(weight * np.log((model + floor) / (power + floor)))
        return np.concatenate(rows)

    lower = np.array([-5.0, math.log(1e-3), math.log(0.1), math.log(2.0 * shortest_m / length_scale_m.max())])
    upper = np.array([4.0, math.log(0.9), math.log(3.0), math.log(0.5 * window_m / length_scale_m.min())])
    ends = [
        least_squares(
            residuals,
            [0.0, math.log(0.1), math.log(0.6), place],
            bounds=(lower, upper),
            ftol=1e-3,
            max_nfev=50,
        )
        for place in lower[3] + np.array([0.25, 0.5]) * (upper[3] - lower[3])
    ]
    best = min(ends, key=lambda end: float(end.cost))
    return wedges_of(best.x), float(best.cost)
