"""Means and trends of samples that hang together, against an autoregressive process."""

import math

import numpy as np
import pytest

from subsoil_ros.analysis.intervals import t_quantile
from subsoil_ros.analysis.stationarity import correlation_steps, stationarity

LAG_ONE = 0.9


def autoregressive(rng: np.random.Generator, count: int, lag_one: float = LAG_ONE) -> np.ndarray:
    """x_k = a x_(k-1) + noise, stationary from the start, standard deviation 1."""
    noise = rng.standard_normal(count) * math.sqrt(1.0 - lag_one**2)
    values = np.empty(count)
    values[0] = rng.standard_normal()
    for k in range(1, count):
        values[k] = lag_one * values[k - 1] + noise[k]
    return values


def test_correlation_time_is_that_of_the_process():
    """(1 + a) / (2 (1 - a)) steps; the estimate over n steps scatters by sqrt(2 (2 M + 1) / n), M = 5 tau."""
    tau = 0.5 * (1.0 + LAG_ONE) / (1.0 - LAG_ONE)
    count = 40_000
    scatter = math.sqrt(2.0 * (2.0 * 5.0 * tau + 1.0) / count)  # Madras and Sokal (1988), eq. E.10
    found = correlation_steps(autoregressive(np.random.default_rng(1), count))
    assert found == pytest.approx(tau, rel=3.0 * scatter + math.exp(-5.0))
    assert correlation_steps(np.random.default_rng(2).standard_normal(count)) == pytest.approx(0.5, rel=0.1)


def test_intervals_hold_what_they_promise():
    """95 % of the intervals of mean, slope and deviation hold the truth, of 200 all but 10 +- 3 sqrt(9.5)."""
    rng = np.random.default_rng(3)
    times = 0.001 * np.arange(2000)
    missed_mean = missed_slope = missed_deviation = 0
    for _ in range(200):
        found = stationarity(times, 5.0 + 2.0 * times + autoregressive(rng, len(times)))
        missed_deviation += abs(found.deviation - 1.0) > found.deviation_half_width
        missed_slope += abs(found.slope_per_s - 2.0) > found.slope_half_width_per_s
        level = stationarity(times, 5.0 + autoregressive(rng, len(times)))
        missed_mean += abs(level.mean - 5.0) > level.mean_half_width
    most = 3.0 * math.sqrt(9.5)
    assert abs(missed_mean - 10) <= most
    assert abs(missed_slope - 10) <= most
    assert abs(missed_deviation - 10) <= most


def test_what_balances_itself_does_not_widen_the_interval():
    """Failure cycles: a draft that rises and falls, each cycle of its own length and height, 30 of them in
    200 stretches. Waves faster than cycles count for nothing: the intervals hold the mean in 90 to 98 %,
    and are a tenth narrower than those from the correlation time."""
    rng = np.random.default_rng(5)
    stretches = []
    for _ in range(200):
        cycles = []
        while sum(map(len, cycles)) < 620:
            length = int(max(5, rng.normal(20.0, 6.0)))
            cycles.append(rng.normal(1.0, 0.1) * np.linspace(0.4, 1.6, length))
        stretches.append(np.concatenate(cycles)[20:620])
    truth = np.mean(stretches)
    found = [stationarity(np.arange(600.0), values) for values in stretches]
    held = np.mean([abs(one.mean - truth) <= one.mean_half_width for one in found])
    assert 0.90 <= held <= 0.985
    by_correlation = [
        values.std(ddof=1) * math.sqrt(2.0 * correlation_steps(values) / 600.0) * t_quantile(30.0)
        for values in stretches
    ]
    assert np.median([one.mean_half_width for one in found]) < 0.9 * np.median(by_correlation)


def test_a_trend_is_told_from_noise():
    """A drift of five standard deviations over the window is seen, noise alone rarely, and blocks rise with
    it."""
    times = 0.001 * np.arange(4000)
    noise = autoregressive(np.random.default_rng(4), len(times))
    drifting = stationarity(times, 100.0 + 5.0 * times / times[-1] + noise)
    assert drifting.verdict == "drifts"
    assert list(drifting.block_means) == sorted(drifting.block_means)
    assert drifting.drift == pytest.approx(5.0 / drifting.mean, rel=0.5)
    assert stationarity(times, 100.0 + noise).verdict == "no drift seen"


def test_a_short_window_judges_nothing():
    """Where nearly all samples hang together there is no verdict; a constant has neither error nor drift."""
    times = 0.001 * np.arange(100)
    assert stationarity(times, np.sin(2.0 * times)).verdict == "too short"
    level = stationarity(times, np.full(100, 7.0))
    assert (level.mean, level.mean_error, level.slope_per_s) == (7.0, 0.0, 0.0)
    assert level.verdict == "no drift seen"
    assert stationarity(times[:15], times[:15]) is None


def test_student_factor():
    """Tables: 12.706 for one degree of freedom, 2.228 for ten, 1.960 for endless many."""
    assert t_quantile(1.0) == pytest.approx(12.706, abs=5e-4)
    assert t_quantile(10.0) == pytest.approx(2.228, abs=5e-4)
    assert t_quantile(1e9) == pytest.approx(1.960, abs=5e-4)
    assert t_quantile(0.0) == math.inf


def test_a_constant_has_no_scatter():
    """Though the mean of its values is rounded: all of them count, and nothing is correlated."""
    found = stationarity(0.001 * np.arange(1999), np.full(1999, 0.1))
    assert found.effective_count == 1999.0
    assert found.correlation_s == pytest.approx(0.0005)
    assert (found.mean_half_width, found.deviation) == (0.0, 0.0)
    assert found.verdict == "no drift seen"
