"""The formula of the draft, against figures by hand."""

import math

import pytest

from reproduction.yuan_yu_2020.draft_formulas import ShearStrength, mckyes_newton


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
