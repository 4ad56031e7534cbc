"""What is computed of the tests of validation.biaxial and wide_blade, without running particles."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from validation import biaxial, wide_blade
from validation.soils import DENSITY, SOLID_FRACTION

GAMMA = SOLID_FRACTION * DENSITY * 9.81


def test_strength_from_peaks(monkeypatch, tmp_path):
    """Curves with a peak on the line of phi = 32 degrees, c = 1.5 kPa, give these, whatever follows it."""
    k_p = math.tan(math.radians(45.0 + 16.0)) ** 2

    def curve(laboratory, soil, seed, least_pa):
        strain = np.linspace(0.0, biaxial.STRAIN, 2000)
        peak = k_p * least_pa + 2.0 * 1500.0 * math.sqrt(k_p)
        rise = np.clip(strain / 0.03, 0.0, 1.0) - 0.3 * np.clip(strain / 0.03 - 2.0, 0.0, 1.0)
        return np.stack([strain, peak * rise, np.full_like(strain, least_pa)], axis=1)

    monkeypatch.setattr(biaxial, "biaxial", curve)
    found = biaxial.strength(biaxial.Laboratory(tmp_path), "loam", 2)
    assert_allclose(found, (1500.0, 32.0), rtol=1e-9)


@pytest.mark.parametrize("cohesion", [0.0, 1200.0])
def test_theory_of_a_smooth_blade_is_rankine_with_the_heave(cohesion):
    """gamma d^2 K_p / 2 + 2 c d sqrt(K_p), and the swept weight spread over the wedge, d sqrt(K_p) long."""
    root = math.tan(math.radians(45.0 + 15.0))
    d = wide_blade.DEPTH_M
    swept = 0.5 * (wide_blade.FIRST_M + wide_blade.LAST_M) * d
    surcharge = GAMMA * swept / (d * root)
    expected = (0.5 * GAMMA * d**2 + surcharge * d) * root**2 + 2.0 * cohesion * d * root
    assert_allclose(wide_blade.theory(biaxial.Strength(cohesion, 30.0), 0.0), expected, rtol=1e-4)


def test_a_blade_that_is_rougher_draws_more():
    """And a cohesion below zero, the scatter of a dry soil, counts as none."""
    sand = biaxial.Strength(-20.0, 31.0)
    assert wide_blade.theory(sand, 0.3) > 1.2 * wide_blade.theory(sand, 0.0)
    assert wide_blade.theory(sand, 0.0) == wide_blade.theory(biaxial.Strength(0.0, 31.0), 0.0)
