"""Failure cycles of made-up drafts whose travel, times and rates are known."""

import numpy as np
import pytest

from subsoil_ros.analysis.failure_cycles import failure_cycles

STEP_S = 1e-3
SPEED_M_PER_S = 0.5


def sawtooth(period_s: float, loading: float, seconds: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and a draft between 0 and 1000 N that rises for a fraction `loading` of each period."""
    times = STEP_S * np.arange(round(seconds / STEP_S))
    phase = (times / period_s) % 1.0
    rising = phase < loading
    return times, 1e3 * np.where(rising, phase / loading, (1.0 - phase) / (1.0 - loading))


@pytest.mark.parametrize(("period_s", "loading"), [(0.2, 0.75), (0.31, 0.6), (0.4, 0.5)])
def test_sawtooth(period_s, loading):
    """Travel is speed times period, and a cycle that loads for a fraction f unloads f / (1 - f) times as
    fast; times are known to a row, so fractions to a row in the period."""
    times, draft = sawtooth(period_s, loading)
    found = failure_cycles(times, SPEED_M_PER_S * times, draft)
    assert found.count == int(4.0 / period_s - loading)
    np.testing.assert_allclose(found.time_s, period_s, atol=1.01 * STEP_S)
    np.testing.assert_allclose(found.travel_m, SPEED_M_PER_S * period_s, atol=1.01 * STEP_S * SPEED_M_PER_S)
    row = STEP_S / period_s
    assert found.loading_fraction == pytest.approx(loading, abs=2.0 * row)
    assert found.unloading_over_loading == pytest.approx(loading / (1.0 - loading), rel=10.0 * row)
    metrics = found.metrics()
    assert metrics["travel_m"]["mean"] == pytest.approx(SPEED_M_PER_S * period_s, rel=row)
    assert metrics["travel_m"]["half_width"] < STEP_S


def test_small_peaks_are_no_failures():
    """A ripple of a tenth of the swing adds peaks, none of which stands out by half a deviation; a second
    peak of 0.7 deviations in each cycle counts at a threshold of half a deviation, not at one."""
    times, draft = sawtooth(0.4, 0.6)
    plain = failure_cycles(times, times, draft)
    rippled = failure_cycles(times, times, draft + 50.0 * np.sin(2.0 * np.pi * times / 0.023), 0.5)
    assert rippled.count == plain.count
    notch = -0.7 * draft.std() * (np.abs((times / 0.4) % 1.0 - 0.8) < 0.02)
    assert failure_cycles(times, times, draft + notch).count == plain.count
    assert failure_cycles(times, times, draft + notch, 0.5).count == 2 * plain.count + 1


def test_too_few_cycles():
    """A constant draft, a single failure and two of them have no scatter."""
    times, draft = sawtooth(0.4, 0.6)
    assert failure_cycles(times, times, np.zeros_like(times)) is None
    few = times < 0.8  # two failures, one cycle
    assert failure_cycles(times[few], times[few], draft[few]) is None
