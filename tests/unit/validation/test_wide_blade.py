"""What is computed in validation.wide_blade, without running particles."""

import math

import pytest
from numpy.testing import assert_allclose

from subsoil_ros.experiments.element_tests import Strength
from validation import wide_blade

DENSITY = 1560.0
GAMMA = DENSITY * 9.81


@pytest.mark.parametrize("cohesion", [0.0, 1200.0])
def test_theory_of_a_smooth_blade_is_rankine_with_the_heave(cohesion):
    """gamma d^2 K_p / 2 + 2 c d sqrt(K_p), and the swept weight spread over the wedge, d sqrt(K_p) long."""
    root = math.tan(math.radians(45.0 + 15.0))
    d = wide_blade.DEPTH_M
    swept = 0.5 * (wide_blade.FIRST_M + wide_blade.LAST_M) * d
    surcharge = GAMMA * swept / (d * root)
    expected = (0.5 * GAMMA * d**2 + surcharge * d) * root**2 + 2.0 * cohesion * d * root
    assert_allclose(wide_blade.theory(Strength(cohesion, 30.0), DENSITY, 0.0), expected, rtol=1e-4)


def test_a_blade_that_is_rougher_draws_more():
    """And a cohesion below zero, the scatter of a dry soil, counts as none."""
    sand = Strength(-20.0, 31.0)
    assert wide_blade.theory(sand, DENSITY, 0.3) > 1.2 * wide_blade.theory(sand, DENSITY, 0.0)
    assert wide_blade.theory(sand, DENSITY, 0.0) == wide_blade.theory(Strength(0.0, 31.0), DENSITY, 0.0)
