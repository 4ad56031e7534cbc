"""Spectra with intervals, against white noise, red noise and a tone."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from subsoil_ros.analysis.spectra import degrees_of_freedom, red_noise, spectrum

STEP_S = 0.002


def test_power_of_a_tone_and_its_frequency():
    """A sine's power, half its amplitude squared, is the area under the density; it stands out of noise."""
    times = STEP_S * np.arange(4000)
    found = spectrum(STEP_S, 3.0 * np.sin(2.0 * math.pi * 5.0 * times) + 100.0 + 2.0 * times)
    width = found.frequency_hz[1]
    assert found.dominant_hz == pytest.approx(5.0, abs=found.resolution_hz)
    # Hann's window spreads a tone over its bin and one to either side: nothing of it is lost
    assert found.density.sum() * width == pytest.approx(4.5, rel=0.02)
    assert found.significant


def test_interval_holds_the_density_of_white_noise():
    """The level is 2 sigma^2 step; 95 % of the intervals hold it: 5 % +- 3 standard deviations of correlated
    bins."""
    rng = np.random.default_rng(5)
    missed = total = 0
    for _ in range(40):
        found = spectrum(STEP_S, 2.0 * rng.standard_normal(2000))
        rows = slice(2, -2)
        level = 2.0 * 4.0 * STEP_S
        missed += int(((found.low[rows] > level) | (found.high[rows] < level)).sum())
        total += len(found.low[rows])
    independent = total / 1.5  # neighbouring bins share Hann's window
    assert missed / total == pytest.approx(0.05, abs=3.0 * math.sqrt(0.05 * 0.95 / independent) + 0.01)


def red(rng, correlation, count=2000):
    """A record of red noise of unit variance."""
    return lfilter([math.sqrt(1.0 - correlation**2)], [1.0, -correlation], rng.standard_normal(count))


@pytest.mark.parametrize("correlation", [0.0, 0.8, 0.98])
def test_red_noise_seldom_stands_out(correlation):
    """The test fires in 5 % of records of red noise at most: of 60 in 3, rarely in more than 9."""
    rng = np.random.default_rng(6)
    assert sum(spectrum(STEP_S, red(rng, correlation)).significant for _ in range(60)) <= 9


def test_a_wander_under_quick_noise_is_no_dominant_frequency():
    """Half the power wanders over 0.2 s, half is noise of 2 ms, which hides the wander at lag one."""
    rng = np.random.default_rng(7)
    records = [red(rng, 0.99) + red(rng, 0.3) for _ in range(60)]
    assert sum(spectrum(STEP_S, record).significant for record in records) <= 9


def test_a_tone_in_red_noise_stands_out():
    """A tone of the same power as the noise is found in every record."""
    rng = np.random.default_rng(8)
    tone = math.sqrt(2.0) * np.sin(2.0 * math.pi * 5.0 * STEP_S * np.arange(2000))
    found = [spectrum(STEP_S, tone + red(rng, 0.9)) for _ in range(20)]
    assert all(one.significant for one in found)
    assert all(one.dominant_hz == pytest.approx(5.0, abs=one.resolution_hz) for one in found)


@pytest.mark.parametrize(("periods", "least", "most"), [(4.0, 0, 2), (8.0, 2, 16), (12.0, 17, 20)])
def test_how_many_periods_a_tone_needs(periods, least, most):
    """Half the power in a tone, half in red noise of 20 ms, 1.8 s: in how many of 20 it is found."""
    rng = np.random.default_rng(9)
    phase = 2.0 * math.pi * periods * np.arange(900) / 900
    records = [
        np.sin(phase + turn) + red(rng, 0.9, 900) / math.sqrt(2.0) for turn in rng.uniform(0.0, 6.0, 20)
    ]
    assert least <= sum(spectrum(STEP_S, record).significant for record in records) <= most


def test_red_noise_keeps_its_variance():
    """The area under the density is the variance."""
    frequency = np.linspace(0.0, 0.5 / STEP_S, 20_001)
    for correlation in (0.0, 0.5, 0.95):
        area = np.trapezoid(red_noise(frequency, STEP_S, correlation), frequency)
        assert area == pytest.approx(1.0, rel=1e-6)


def test_degrees_of_freedom():
    """One segment has 2; many at half overlap come to 36 K^2 / (19 K - 1) for Hann's window (Welch 1967)."""
    assert degrees_of_freedom(400, 400) == pytest.approx(2.0)
    segments = 50
    assert degrees_of_freedom(200 * (segments + 1), 400) == pytest.approx(
        2.0 * 18.0 * segments**2 / (19.0 * segments - 1.0), rel=0.01
    )


def test_no_spectrum_without_a_record():
    """Too few values, or a constant."""
    assert spectrum(STEP_S, np.arange(10.0)) is None
    assert spectrum(STEP_S, np.full(500, 3.3)) is None
    assert spectrum(STEP_S, 1e3 + 0.1 * np.arange(500)) is None
