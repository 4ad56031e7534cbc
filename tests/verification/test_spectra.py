"""Spectra with intervals, against white noise, red noise and a tone."""

import math

import numpy as np
import pytest

from subsoil_ros.analysis.spectra import degrees_of_freedom, spectrum

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


def test_red_noise_seldom_stands_out():
    """The test fires in 5 % of records of red noise: in 60 of them in 3, and rarely in more than 9."""
    rng = np.random.default_rng(6)
    fired = 0
    for _ in range(60):
        noise = rng.standard_normal(2000)
        values = np.empty_like(noise)
        values[0] = noise[0]
        for k in range(1, len(noise)):
            values[k] = 0.8 * values[k - 1] + noise[k]
        fired += spectrum(STEP_S, values).significant
    assert fired <= 9


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
