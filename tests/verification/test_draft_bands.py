"""Independent formulas and paired statistics, against figures by hand and another implementation."""

import math

import numpy as np
import pytest
from scipy.stats import ttest_rel

from subsoil_ros.analysis.draft_bands import ShearStrength, asabe_newton, mckyes_newton
from subsoil_ros.analysis.intervals import paired_difference


def test_asabe_at_the_papers_speed():
    """0.30 m at 1.8 km/h: 30 (226 + 1.8 x 3.24) = 6955 N in fine soil, 3130 N in coarse (3 to 7 kN)."""
    assert asabe_newton(0.30, 0.5, "fine") == pytest.approx(6954.96, abs=0.01)
    assert asabe_newton(0.30, 0.5, "coarse") == pytest.approx(0.45 * 6954.96, abs=0.01)
    assert asabe_newton(0.15, 0.5, "fine") == pytest.approx(0.5 * asabe_newton(0.30, 0.5, "fine"))


def test_mckyes_of_a_wide_wall_in_clay():
    """Smooth, upright and wide, no friction: passive earth pressure gamma d^2 / 2 + 2 c d on each metre."""
    clay = ShearStrength(20e3, 0.0, 1800.0, "clay")
    width, depth = 1e4, 0.3
    per_metre = 0.5 * 1800.0 * 9.81 * depth**2 + 2.0 * 20e3 * depth
    assert mckyes_newton(depth, 0.0, clay, width, math.pi / 2) / width == pytest.approx(per_metre, rel=1e-3)


def test_mckyes_grows_with_depth_and_strength():
    """Deeper and stronger soil resists more, and speed adds its inertia."""
    soil = ShearStrength(20e3, 0.5, 1300.0, "soil")
    drafts = [mckyes_newton(depth, 0.5, soil, 0.06, 0.44) for depth in (0.12, 0.18, 0.24, 0.30)]
    assert drafts == sorted(drafts)
    assert mckyes_newton(0.2, 2.0, soil, 0.06, 0.44) > mckyes_newton(0.2, 0.5, soil, 0.06, 0.44)
    assert mckyes_newton(0.2, 0.5, soil._replace(cohesion_pa=4e4), 0.06, 0.44) > drafts[1]


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
