"""The failure wedge and the wheel of the wedge model against closed forms and published coefficients."""

import math

import numpy as np
import pytest

from subsoil_ros.scene.tool_faces import WheelFace
from subsoil_ros.scene.wedge_soil import WedgeValues, WheelSoil
from subsoil_ros.wedge.failure_wedge import (
    Plate,
    Strength,
    failure,
    lateral_pressure,
    least_wedge,
    wedge_force,
    wedge_terms,
)
from subsoil_ros.wedge.wedge_forces import grip_newton, rolling_resistance_newton, wheel_load_newton
from validation import blades

WIDE = 1e4
"""Width over depth at which two crescents weigh less than 1e-3 of the wedge."""

# Golden section leaves beta within 8e-5 rad; the force errs by its square times a curvature of order one.
SEARCHED = 1e-6
CRESCENTS = 1e-3


def strength(phi=30.0, delta=0.0, gamma=0.0, c=0.0, c_a=0.0, q=0.0, speed_factor=0.0):
    """Angles in degrees."""
    return Strength(gamma, gamma / 9.81, c, math.radians(phi), c_a, math.radians(delta), q, speed_factor)


def plate(rake=90.0, width=WIDE, depth=1.0):
    """A plate that reaches the surface."""
    return Plate(width, math.radians(rake), depth, depth)


def coulomb(rake, phi, delta):
    """Coulomb's passive coefficient of a wall of this rake [degrees], level ground: P = K gamma d^2 / 2."""
    alpha, phi, delta = math.radians(rake), math.radians(phi), math.radians(delta)
    root = math.sqrt(math.sin(phi + delta) * math.sin(phi) / math.sin(alpha + delta) / math.sin(alpha))
    return math.sin(alpha - phi) ** 2 / (math.sin(alpha) ** 2 * math.sin(alpha + delta) * (1.0 - root) ** 2)


@pytest.mark.parametrize("rake", [25.0, 45.0, 90.0])
def test_plane_sides_are_those_of_perumpral(rake):
    """The least wedge is that of the closed form by equilibrium across the plane's reaction."""
    soil = blades.Soil(1e4, math.radians(32.0), 1450.0, math.radians(23.0))
    for width, depth in ((0.06, 0.2), (WIDE, 1.0)):
        blade = blades.Blade(width, depth, math.radians(rake))
        beta, force = least_wedge(
            Plate(width, blade.rake_rad, depth, depth), soil.strength._replace(plane_sides=True), 0.0
        )
        known = blades.perumpral(soil, blade)
        assert force * math.sin(blade.rake_rad + soil.delta_rad) == pytest.approx(
            known.draft_newton, rel=SEARCHED
        )
        assert beta == pytest.approx(known.beta_rad, abs=2e-4)


def test_smooth_upright_wall_fails_by_rankine():
    """beta = 45 - phi/2; N_gamma = K_p / 2, N_c = 2 sqrt(K_p), N_q = K_p (K_p = 3 at 30 degrees)."""
    beta, force = least_wedge(plate(), strength(gamma=1e4), 0.0)
    assert beta == pytest.approx(math.radians(30.0), abs=2e-4)
    assert force / WIDE == pytest.approx(0.5 * 3.0 * 1e4, rel=CRESCENTS)
    assert least_wedge(plate(), strength(c=1e3), 0.0)[1] / WIDE == pytest.approx(
        2.0 * math.sqrt(3.0) * 1e3, rel=CRESCENTS
    )
    assert least_wedge(plate(), strength(q=1e3), 0.0)[1] / WIDE == pytest.approx(3.0 * 1e3, rel=CRESCENTS)


def test_undrained_clay_on_a_smooth_upright_wall():
    """Without friction 2 c per depth, at 45 degrees."""
    beta, force = least_wedge(plate(), strength(phi=0.0, c=1e3), 0.0)
    assert beta == pytest.approx(math.radians(45.0), abs=2e-4)
    assert force / WIDE == pytest.approx(2e3, rel=CRESCENTS)


@pytest.mark.parametrize(
    ("phi", "delta", "published"),
    [(30.0, 0.0, 3.000), (30.0, 20.0, 6.105), (36.0, 0.0, 3.852), (40.0, 20.0, 11.771)],
)
def test_published_passive_coefficients(phi, delta, published):
    """Coulomb's K_p of an upright wall, J.E. Bowles, Foundation Analysis and Design (1996), table 11-4."""
    force = least_wedge(plate(), strength(phi, delta, gamma=2.0), 0.0)[1]
    assert force / WIDE == pytest.approx(published, rel=CRESCENTS)


@pytest.mark.parametrize("rake", [30.0, 45.0, 60.0, 75.0, 90.0])
@pytest.mark.parametrize(("phi", "delta"), [(20.0, 0.0), (35.0, 20.0)])
def test_raked_wide_blade_is_coulombs_wall(rake, phi, delta):
    """In two dimensions the least wedge is Coulomb's, whatever the rake."""
    force = least_wedge(plate(rake, width=1e7), strength(phi, delta, gamma=2.0), 0.0)[1]
    assert force / 1e7 == pytest.approx(coulomb(rake, phi, delta), rel=1e-5)


@pytest.mark.parametrize("beta", [0.3, 0.6, 0.9])
def test_the_wedge_is_in_equilibrium(beta):
    """Weight, surcharge, cohesion, adhesion, inertia, reaction at phi: both sums of forces are zero."""
    soil = strength(32.0, 18.0, gamma=1.5e4, c=4e3, c_a=1.5e3, q=2e3, speed_factor=1.0)
    tool, speed = plate(50.0, width=1e7, depth=0.3), 2.0
    alpha, phi, delta, d = tool.rake, soil.friction, soil.tool_friction, tool.depth
    p = wedge_force(tool, soil, speed, beta) / tool.width
    length = d * (1.0 / math.tan(alpha) + 1.0 / math.tan(beta))
    flux = soil.density * speed * d  # mass per time and width that the wedge takes up
    inertia = flux * speed / (math.cos(beta) + math.sin(beta) / math.tan(alpha))
    along = soil.cohesion * d / math.sin(beta) + inertia
    forward = p * math.sin(alpha + delta) + soil.adhesion * d / math.tan(alpha) - along * math.cos(beta)
    reaction = forward / math.sin(beta + phi)
    upward = p * math.cos(alpha + delta) - soil.adhesion * d + reaction * math.cos(beta + phi)
    upward -= 0.5 * soil.unit_weight * d * length + soil.surcharge * length + along * math.sin(beta)
    # the crescents of a plate 3e7 depths wide are what is left
    assert upward == pytest.approx(0.0, abs=1e-6 * p)


def test_parts_add_up_and_scale_with_what_makes_them():
    """Weight with d^2 w, cohesion and adhesion with d w in two dimensions; inertia with the speed squared."""
    soil = strength(30.0, 15.0, gamma=1e4, c=1e3, c_a=500.0, q=100.0, speed_factor=1.0)
    one, two = (wedge_terms(plate(60.0, 1e6, d), soil, 0.5) for d in (0.2, 0.4))
    assert np.divide(two, one) == pytest.approx([2.0, 4.0, 2.0, 2.0, 2.0, 2.0], rel=1e-5)
    assert sum(one[1:5]) + 9.0 * one[5] == pytest.approx(wedge_force(plate(60.0, 1e6, 0.2), soil, 3.0, 0.5))


def test_crescents_make_a_narrow_blade_resist_more_per_width():
    """McKyes and Ali: N_gamma (w + 2 s / 3), N_c (w + s), s = d sqrt(cot^2 beta + 2 cot alpha cot beta)."""
    beta, d = 0.6, 0.2
    side = d * math.sqrt(1.0 / math.tan(beta) ** 2 + 2.0 / math.tan(beta) / math.tan(math.radians(60.0)))
    for soil, part in ((strength(gamma=1e4), 2.0 / 3.0), (strength(c=1e3), 1.0)):
        narrow = wedge_force(plate(60.0, 0.05, d), soil, 0.0, beta)
        wide = wedge_force(plate(60.0, 1e7, d), soil, 0.0, beta) / 1e7
        assert narrow / wide == pytest.approx(0.05 + part * side, rel=1e-6)


def test_least_wedge_is_the_least():
    """No other rupture angle gives less, also where there are two minima (narrow, low rake)."""
    soil = strength(25.0, 10.0, gamma=1.3e4, c=5e3)
    for rake in (20.0, 35.0, 60.0, 90.0):
        for width in (0.02, 0.1, 1.0):
            tool = plate(rake, width, 0.25)
            beta, force = least_wedge(tool, soil, 1.0)
            last = min(math.pi - tool.rake - soil.friction - soil.tool_friction - 1e-6, 0.5 * math.pi)
            others = [wedge_force(tool, soil, 1.0, b) for b in np.linspace(0.02, last, 400)]
            assert force <= min(others) * (1.0 + SEARCHED)
            assert 0.0 < beta <= last


def test_deep_flow_without_friction():
    """In clay (2 pi + 2) c, the limit of (N_q - 1) / tan phi; else N_q = K_p e^(2 pi tan phi)."""
    assert lateral_pressure(strength(0.0, c=1e3), 1.0, 0.0) == pytest.approx((2.0 * math.pi + 2.0) * 1e3)
    assert lateral_pressure(strength(1e-5, c=1e3), 1.0, 0.0) == pytest.approx(
        (2.0 * math.pi + 2.0) * 1e3, rel=1e-5
    )
    n_q = 3.0 * math.exp(2.0 * math.pi * math.tan(math.radians(30.0)))
    fast = lateral_pressure(strength(0.0, gamma=9.81, c=1e3, speed_factor=2.0), 0.0, 3.0)
    assert fast == pytest.approx((2.0 * math.pi + 2.0) * 1e3 + 2.0 * 1.0 * 3.0**2)
    assert lateral_pressure(strength(30.0, gamma=1e4), 0.5, 0.0) == pytest.approx(0.5 * 0.5e4 * n_q)


def test_below_the_critical_depth_soil_flows_around():
    """A narrow upright blade: shallow it is all wedge; deep, a wedge over a part and flow below give less."""
    soil = strength(20.0, 12.0, gamma=1.3e4, c=8e3)
    shallow, deep = (Plate(0.03, 0.5 * math.pi, d, d) for d in (0.03, 0.28))
    assert failure(shallow, soil, 0.0)[1] == least_wedge(shallow, soil, 0.0)[1]
    least = failure(deep, soil, 0.0)[1]
    assert least < 0.9 * least_wedge(deep, soil, 0.0)[1]
    around = lateral_pressure(soil, 0.14, 0.0) * 0.03 * 0.28 / math.sin(0.5 * math.pi + soil.tool_friction)
    assert least < around


def test_force_is_continuous_with_depth_and_zero_at_the_surface():
    """Through the surface, the top of the share and the critical depth: steps of 0.1 mm change it little."""
    soil = strength(20.0, 12.0, gamma=1.3e4, c=8e3, c_a=1e3, speed_factor=1.0)
    depths = np.arange(0.0, 0.4, 1e-4)
    for width, rake, tall in ((0.06, 25.0, 0.076), (0.03, 87.0, 1.0)):
        forces = np.array(
            [failure(Plate(width, math.radians(rake), d, min(d, tall)), soil, 1.0)[1] for d in depths]
        )
        assert forces[0] == 0.0
        assert np.all(np.diff(forces) > -SEARCHED * forces.max())
        assert np.diff(forces).max() < 2e-3 * forces.max()


@pytest.mark.parametrize("n", [0.5, 1.0, 1.5])
def test_wheel_load_is_the_integral_of_the_pressure(n):
    """Bekker: k z^n along the arc x^2 = D (z_0 - z); his two terms of a series are exact at n = 1."""
    wheel, soil = WheelFace(0.2, 0.1), WheelSoil(cohesive_modulus=1e3, frictional_modulus=1e6, exponent=n)
    z0 = 0.02
    x = np.linspace(0.0, math.sqrt(0.4 * z0), 20001)
    pressure = (1e3 / 0.1 + 1e6) * (z0 - x**2 / 0.4) ** n
    exact = 0.1 * np.trapezoid(pressure, x)
    # Bekker keeps two terms of (z0 - t^2)^n: 1 - n/3 instead of the beta function
    beta = 0.5 * math.sqrt(math.pi) * math.gamma(n + 1.0) / math.gamma(n + 1.5)
    assert wheel_load_newton(wheel, soil, z0) * beta / (1.0 - n / 3.0) == pytest.approx(exact, rel=1e-5)
    assert rolling_resistance_newton(wheel, soil, z0) == pytest.approx(
        0.1 * 1.01e6 * z0 ** (n + 1.0) / (n + 1.0)
    )


def test_grip_goes_from_stiffness_to_strength():
    """Janosi and Hanamoto along the contact: x / 2 for little slip, all of W tan phi + b L c for much."""
    wheels = WheelSoil(cohesive_modulus=0.0, frictional_modulus=1e6, exponent=1.0, shear_deformation_m=0.01)
    values = WedgeValues(
        density_kg_per_m3=1500.0, cohesion_pa=2e3, friction_angle_rad=0.5, adhesion_pa=0.0,
        tool_friction_angle_rad=0.3, wheels=wheels,
    )  # fmt: skip
    wheel = WheelFace(0.2, 0.1)
    most = 500.0 * math.tan(0.5) + 0.1 * 0.1 * 2e3  # L = sqrt(0.4 x 0.025) = 0.1 m
    assert grip_newton(wheel, values, 500.0, 0.025, 1e6) == pytest.approx(most, rel=1e-5)
    assert grip_newton(wheel, values, 500.0, 0.025, 1e-5) == pytest.approx(0.5 * most * 1e-4, rel=1e-4)
    assert grip_newton(wheel, values, 500.0, 0.025, 0.0) == 0.0
