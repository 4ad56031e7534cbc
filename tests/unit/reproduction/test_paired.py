"""Paired statistics against another implementation."""

import math

import numpy as np
import pytest
from scipy.stats import ttest_rel

from reproduction.yuan_yu_2020.paired import paired_difference


def test_paired_interval_is_students():
    """As scipy's paired test gives it; pairing takes out what the beds have in common."""
    rng = np.random.default_rng(7)
    beds = 700.0 + 100.0 * rng.standard_normal(8)
    sprung = beds + 5.0 * rng.standard_normal(8)
    locked = beds + 40.0 + 5.0 * rng.standard_normal(8)
    found = paired_difference(sprung.tolist(), locked.tolist())
    interval = ttest_rel(locked, sprung).confidence_interval(0.95)
    assert found.difference == pytest.approx(float((locked - sprung).mean()))
    assert found.half_width == pytest.approx(0.5 * (interval.high - interval.low))
    assert found.verdict == "saves"
    assert found.resolved(0.02)
    assert found.saving == pytest.approx(found.difference / float(locked.mean()))


def test_one_pair_tells_no_interval():
    """Nor do numbers that are no pairs make a difference."""
    found = paired_difference([500.0], [600.0])
    assert found.half_width == math.inf
    assert not found.resolved(0.5)
    assert "no interval" in found.verdict
    with pytest.raises(ValueError, match="no pairs"):
        paired_difference([1.0, 2.0], [1.0])
