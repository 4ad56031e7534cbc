"""Intervals over seeds: against printed quantiles of Student's t, and by how often they hold the truth."""

import math

import numpy as np
import pytest

from subsoil_ros.analysis.intervals import (
    difference_by_seed,
    error_against_one,
    error_by_seed,
    mean_interval,
    t_quantile,
)


@pytest.mark.parametrize(
    ("freedoms", "confidence", "printed"),
    [(1, 0.95, 12.706), (2, 0.95, 4.303), (4, 0.95, 2.776), (9, 0.99, 3.250), (30, 0.90, 1.697)],
)
def test_quantiles_are_the_printed_ones(freedoms: int, confidence: float, printed: float) -> None:
    """NIST/SEMATECH e-Handbook, table of critical values of Student's t, to its last digit."""
    assert t_quantile(freedoms, confidence) == pytest.approx(printed, abs=6e-4)


def test_interval_of_three_values_by_hand() -> None:
    """1, 2, 3: mean 2, s = 1, half-width 4.303 / sqrt(3)."""
    found = mean_interval([1.0, 2.0, 3.0])
    assert (found.mean, found.count) == (2.0, 3)
    assert found.half_width == pytest.approx(4.3027 / math.sqrt(3.0), rel=1e-4)
    assert not found.resolved
    assert mean_interval([10.0, 11.0, 12.0]).resolved


@pytest.mark.parametrize("scatter", [0.0, 1e-6, 1.0, 1e4])
def test_interval_is_students_formula(scatter: float) -> None:
    """t(n - 1) s / sqrt(n) to round-off of the mean (1e-14); all equal, without a warning: no width."""
    random = np.random.default_rng(6)
    for count in (2, 3, 7, 30):
        values = 100.0 + scatter * random.normal(size=count)
        found = mean_interval(values.tolist(), 0.9)
        by_hand = t_quantile(count - 1, 0.9) * float(np.std(values, ddof=1)) / math.sqrt(count)
        assert found.mean == float(np.mean(values))
        assert found.half_width == pytest.approx(by_hand, rel=1e-14, abs=1e-14 * abs(found.mean))


def test_interval_holds_the_truth_as_often_as_it_says() -> None:
    """Of 4000 samples of four normal values 95 % hold the mean: within 3 sigma of the binomial, 0.0103."""
    random = np.random.default_rng(5)
    hits = [
        abs(found.mean) <= found.half_width for found in map(mean_interval, random.normal(size=(4000, 4)))
    ]
    assert np.mean(hits) == pytest.approx(0.95, abs=3.0 * math.sqrt(0.95 * 0.05 / 4000))


def test_pairs_take_the_beds_out() -> None:
    """Scatter that both runs of a seed share does not hide a difference; seeds of only one do not count."""
    bed = {0: 100.0, 1: 140.0, 2: 60.0, 3: 90.0}
    other = {seed: value + 5.0 + 0.1 * seed for seed, value in bed.items() if seed != 3}
    found = difference_by_seed(other, bed)
    assert (found.count, found.mean) == (3, pytest.approx(5.1))
    assert found.resolved
    assert found.half_width == pytest.approx(4.3027 * 0.1 / math.sqrt(3.0), rel=1e-3)


def test_one_seed_resolves_nothing() -> None:
    """Without scatter known there is no interval, whatever the difference."""
    found = mean_interval([1000.0])
    assert math.isnan(found.half_width)
    assert not found.resolved


def test_relative_errors_hold_the_truth() -> None:
    """Ratio of two means that both scatter, paired and not: 95 % of the intervals hold it."""
    random = np.random.default_rng(4)
    for paired in (0.0, 0.9):
        hits = []
        for _ in range(3000):
            beds, own = random.normal(size=(2, 4))
            true = dict(enumerate(1000.0 + 30.0 * beds))
            other = dict(enumerate(850.0 + 30.0 * (paired * beds + math.sqrt(1.0 - paired**2) * own)))
            found = error_by_seed(other, true)
            hits.append(found.low <= -0.15 <= found.high)
        assert np.mean(hits) == pytest.approx(0.95, abs=0.015)
    assert error_by_seed({0: 2.0, 1: 3.0}, {0: 2.0, 2: 9.0}).mean == 0.0  # of the shared seeds alone


def test_a_single_reference_has_the_scatter_it_is_given() -> None:
    """Against one run: s^2 / n of the values and (ratio x scatter)^2, over the reference, times t."""
    values = [1.0, 2.0, 3.0]  # s = 1
    found = error_against_one(values, 1.5, scatter=1.0, scatter_count=3)
    assert found.mean == pytest.approx(0.5 / 1.5)
    assert found.half_width == pytest.approx(4.3027 * math.sqrt(1.0 / 3.0 + (2.0 / 1.5) ** 2) / 1.5, rel=1e-4)
    fewer = error_against_one(values, 1.5, scatter=1.0, scatter_count=2)
    assert fewer.half_width == pytest.approx(12.706 / 4.3027 * found.half_width, rel=1e-4)
    assert math.isnan(error_against_one(values, 1.5, scatter=math.nan, scatter_count=1).half_width)
